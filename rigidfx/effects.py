"""What may act in a scene: loads, supports, damping, initial motion, static preload.

Every effect is a frozen record in SI units with a time window and knows at which instants it
changes abruptly; steps end exactly there. An effect that a scene does not name adds nothing to the
compiled forms.

All loads here are dead: their direction in space does not follow the body. Such a load is a fixed
nodal weight times a force in time, fᵢ(t) = wᵢ q(t); the weights are assembled once and a step only
evaluates q at its midpoint.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.errors import SceneError

__all__ = [
    "BodyForce",
    "DeadLoad",
    "Effect",
    "Fixed",
    "Gravity",
    "InitialVelocity",
    "NodalForce",
    "NumericalDamping",
    "Preload",
    "PrescribedMotion",
    "Resultant",
    "Rigid",
    "Support",
    "Table",
    "Traction",
    "Windowed",
]

Vector = tuple[float, float, float]
TimeFunction = Callable[[float], float]


def _vector(owner: object, name: str, value: Any) -> npt.NDArray[np.float64]:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(
            f"{type(owner).__name__}: {name} must be three finite numbers, got {value!r}."
        )
    return array


@dataclass(frozen=True)
class Table:
    """A piecewise linear function of time; constant before the first and after the last time.

    Every interior kink is a breakpoint at which a step ends.

    Attributes:
        times: Strictly increasing instants [s].
        values: Value at each instant, in the unit of what it multiplies.
    """

    times: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        """Check the table.

        Raises:
            SceneError: If lengths differ, times do not increase or a number is not finite.
        """
        times, values = np.asarray(self.times, float), np.asarray(self.values, float)
        if times.ndim != 1 or times.shape != values.shape or times.size == 0:
            raise SceneError("Table: times and values must be lists of the same length ≥ 1.")
        if not (np.isfinite(times).all() and np.isfinite(values).all()):
            raise SceneError("Table: times and values must be finite.")
        if np.any(np.diff(times) <= 0):
            raise SceneError("Table: times must increase strictly; a jump takes a time window.")

    def __call__(self, t: float) -> float:
        """Value at time t [s]."""
        return float(np.interp(t, self.times, self.values))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Instants of the kinks [s]."""
        return tuple(float(t) for t in self.times)


class Effect:
    """Anything a scene may name."""


@dataclass(frozen=True)
class Windowed(Effect):
    """An effect that acts in a time window.

    Attributes:
        since: Begin of the window [s].
        until: End of the window [s].
    """

    since: float = field(default=-inf, kw_only=True)
    until: float = field(default=inf, kw_only=True)

    def __post_init__(self) -> None:
        """Check the window.

        Raises:
            SceneError: If it is empty or its ends are not numbers.
        """
        if not self.since < self.until:
            raise SceneError(
                f"{type(self).__name__}: the time window needs since < until, "
                f"got {self.since!r} … {self.until!r}."
            )

    def active(self, t: float) -> bool:
        """Whether the effect acts in a step whose midpoint is t [s]."""
        return self.since <= t <= self.until

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Instants at which a step must end [s]."""
        return tuple(t for t in (self.since, self.until) if isfinite(t))


@dataclass(frozen=True)
class DeadLoad(Windowed):
    """A load whose direction in space does not follow the body.

    Attributes:
        time: Factor as a function of time, such as a `Table`; 1 if None. An attribute
            `breakpoints` of it names instants at which steps must end.
    """

    time: TimeFunction | None = field(default=None, kw_only=True)

    def intensity(self, t: float) -> npt.NDArray[np.float64]:
        """Vector q(t), shape (3,), that multiplies the nodal weights; zero outside the window.

        Args:
            t: Time [s].
        """
        if not self.active(t):
            return np.zeros(3)
        value = getattr(self, "value", (0.0, 0.0, 0.0))
        vector = np.asarray(value(t) if callable(value) else value, dtype=np.float64)
        return vector if self.time is None else vector * float(self.time(t))

    def __post_init__(self) -> None:
        """Check window, value and time function.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        value = getattr(self, "value", None)
        if not callable(value):
            _vector(self, "value", value)
        if self.time is not None and not callable(self.time):
            raise SceneError(
                f"{type(self).__name__}: time must be a function of t, got {self.time!r}."
            )

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Ends of the window and declared breakpoints of the time function [s]."""
        value = getattr(self, "value", None)
        kinks = [*getattr(self.time, "breakpoints", ()), *getattr(value, "breakpoints", ())]
        return (*super().breakpoints, *(t for t in kinks if self.since < t < self.until))


@dataclass(frozen=True)
class Traction(DeadLoad):
    """Dead traction on named facets, per reference area [Pa].

    Attributes:
        where: Name of a set of facets.
        value: Three components [Pa], or a function of time giving them.
    """

    where: str
    value: Vector | Callable[[float], Vector]


@dataclass(frozen=True)
class NodalForce(DeadLoad):
    """A total force spread in equal parts over the nodes of a named set.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        value: Three components of the *total* force [N], or a function of time giving them.
    """

    where: str
    value: Vector | Callable[[float], Vector]


@dataclass(frozen=True)
class BodyForce(DeadLoad):
    """Dead force per reference volume [N/m³].

    Attributes:
        value: Three components [N/m³], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector]
    where: str | None = None


@dataclass(frozen=True)
class Gravity(DeadLoad):
    """Uniform acceleration field: force ρ0 g per reference volume.

    Attributes:
        value: Acceleration g, three components [m/s²], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector] = (0.0, 0.0, -9.81)
    where: str | None = None


@dataclass(frozen=True)
class Support(Windowed):
    """Prescribes components of the motion of a named set's nodes.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        components: Which of the components x, y, z are held, for example "xz".
    """

    where: str
    components: str = "xyz"

    def __post_init__(self) -> None:
        """Check window and components.

        Raises:
            SceneError: If components is empty or names anything but x, y, z once each.
        """
        super().__post_init__()
        c = self.components
        if not c or set(c) - set("xyz") or len(set(c)) != len(c):
            raise SceneError(
                f"{type(self).__name__} on '{self.where}': components must be some of 'xyz', "
                f"each once, got {c!r}."
            )

    @property
    def axes(self) -> tuple[int, ...]:
        """The held components as numbers 0, 1, 2."""
        return tuple("xyz".index(c) for c in self.components)

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """Prescribed displacement, shape (3,) [m], up to a constant of no consequence."""
        raise NotImplementedError

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """Prescribed velocity just after t, shape (3,) [m/s].

        Args:
            t: Time [s].
            dt: Time step [s], the scale of the difference quotient where one is needed.
        """
        raise NotImplementedError

    def same_motion(self, other: Support) -> bool:
        """Whether both prescribe the same motion, so that they may share nodes."""
        raise NotImplementedError


@dataclass(frozen=True)
class Fixed(Support):
    """Holds the nodes of a named set where they are when the window begins."""

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """Zero."""
        return np.zeros(3)

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """Zero."""
        return np.zeros(3)

    def same_motion(self, other: Support) -> bool:
        """Two fixed supports never disagree."""
        return isinstance(other, Fixed)


@dataclass(frozen=True)
class PrescribedMotion(Support):
    """Moves the nodes of a named set along a given path, from where they are at its begin.

    Attributes:
        displacement: Function t → three components of the displacement [m]; only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s]; by a one-sided second-order difference if None. It is
            used where the motion begins and after each breakpoint.
    """

    displacement: Callable[[float], Vector] = field(kw_only=True)
    velocity: Callable[[float], Vector] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window, components and functions.

        Raises:
            SceneError: If displacement or velocity is not a function.
        """
        super().__post_init__()
        for name in ("displacement", "velocity"):
            f = getattr(self, name)
            if not callable(f) and not (name == "velocity" and f is None):
                raise SceneError(
                    f"PrescribedMotion on '{self.where}': {name} must be a function of t, "
                    f"got {f!r}."
                )

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Ends of the window and declared kinks of the motion [s]."""
        kinks = getattr(self.displacement, "breakpoints", ())
        return (*super().breakpoints, *(t for t in kinks if self.since < t < self.until))

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """The given path at t."""
        return np.asarray(self.displacement(t), dtype=np.float64)

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """The given velocity at t, or the difference quotient of the path just after t."""
        if self.velocity is not None:
            return np.asarray(self.velocity(t), dtype=np.float64)
        h = 1e-3 * dt
        u0, u1, u2 = (self.displacement_at(t + k * h) for k in range(3))
        return (4 * u1 - 3 * u0 - u2) / (2 * h)

    def same_motion(self, other: Support) -> bool:
        """The same path given by the same function."""
        return isinstance(other, PrescribedMotion) and other.displacement == self.displacement


@dataclass(frozen=True)
class InitialVelocity(Effect):
    """Velocity at the start: a rigid motion, or any function of the reference position.

    Attributes:
        linear: Velocity of the centre [m/s].
        angular: Angular velocity ω [rad/s].
        centre: Point of the rotation [m]; the centre of mass if None.
        function: x of shape (3, n) [m] → velocities of shape (3, n) [m/s], added to the rigid
            motion.
    """

    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)
    centre: Vector | None = None
    function: Callable[[npt.NDArray[np.float64]], npt.ArrayLike] | None = None

    def __post_init__(self) -> None:
        """Check the vectors.

        Raises:
            SceneError: If one is not three finite numbers, or `function` is not callable.
        """
        _vector(self, "linear", self.linear)
        _vector(self, "angular", self.angular)
        if self.centre is not None:
            _vector(self, "centre", self.centre)
        if self.function is not None and not callable(self.function):
            raise SceneError("InitialVelocity: function must be callable.")


@dataclass(frozen=True)
class NumericalDamping(Windowed):
    """High-frequency dissipation of Armero and Petöcz, equation (22).

    Attributes:
        xi: ξ ≥ 0, dimensionless; the scheme is of first order in Δt where ξ > 0.
    """

    xi: float

    def __post_init__(self) -> None:
        """Check ξ.

        Raises:
            SceneError: If ξ is negative, above ½ or not finite.
        """
        super().__post_init__()
        if not (isfinite(self.xi) and 0 <= self.xi <= 0.5):
            raise SceneError(f"NumericalDamping: xi must lie in [0, 1/2], got {self.xi!r}.")


@dataclass(frozen=True)
class Preload(Effect):
    """Static equilibrium under loads of its own, found before the dynamics start from rest in it.

    The loads act in the statics only: one that is to stay on is named in the scene as well, one
    that is not is thereby let go suddenly at the start.

    Attributes:
        loads: Dead loads, taken at the start time.
        increments: Number of equal load increments.
    """

    loads: Sequence[DeadLoad]
    increments: int = 1

    def __post_init__(self) -> None:
        """Check the loads.

        Raises:
            SceneError: If there are none, one is not a dead load, or increments < 1.
        """
        object.__setattr__(self, "loads", tuple(self.loads))
        if not self.loads or not all(isinstance(load, DeadLoad) for load in self.loads):
            raise SceneError("Preload: loads must be one or more dead loads.")
        if int(self.increments) != self.increments or self.increments < 1:
            raise SceneError(f"Preload: increments must be an integer ≥ 1, got {self.increments}.")


@dataclass(frozen=True)
class Rigid(Effect):
    """Cells that move as one rigid body from the beginning.

    A body whose nodes a support holds is refused, unless all components of three or more of its
    nodes that do not lie on a line are held by one support: then it is fixed, or follows the
    support's motion.

    Attributes:
        where: Name of a set of cells; all cells if None.
        mass: Mass in place of the computed one [kg].
        inertia: Inertia about the centre of mass in place of the computed one, shape (3, 3)
            [kg m²].
    """

    where: str | None = None
    mass: float | None = None
    inertia: Sequence[Sequence[float]] | None = None

    def __post_init__(self) -> None:
        """Check the given data.

        Raises:
            SceneError: If the mass is not positive or the inertia not symmetric positive definite
                with principal moments that a body can have.
        """
        if self.mass is not None and not (isfinite(self.mass) and self.mass > 0):
            raise SceneError(f"Rigid: mass must be a finite number > 0, got {self.mass!r}.")
        if self.inertia is None:
            return
        J = np.asarray(self.inertia, dtype=np.float64)
        if J.shape != (3, 3) or not np.isfinite(J).all() or not np.allclose(J, J.T, rtol=1e-12):
            raise SceneError(f"Rigid: inertia must be a symmetric 3×3 matrix, got {self.inertia}.")
        a, b, c = np.linalg.eigvalsh(J)
        if a <= 0 or c > (a + b) * (1 + 1e-9):
            raise SceneError(
                f"Rigid: no body has the principal moments of inertia {a:.3g}, {b:.3g}, {c:.3g}: "
                "they must be positive and none above the sum of the others."
            )


@dataclass(frozen=True)
class Resultant(Windowed):
    """A force through the centre of mass and a torque on a rigid body; both keep their direction.

    Attributes:
        where: Name of the body's set of cells; None for the body of all cells.
        force: Three components [N].
        torque: Three components [N m].
        time: Factor as a function of time, such as a `Table`; 1 if None.
    """

    where: str | None = None
    force: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, 0.0, 0.0)
    time: TimeFunction | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check window and vectors.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        _vector(self, "force", self.force)
        _vector(self, "torque", self.torque)

    def _factor(self, t: float) -> float:
        return 0.0 if not self.active(t) else 1.0 if self.time is None else float(self.time(t))

    def force_at(self, t: float) -> npt.NDArray[np.float64]:
        """Force at t, shape (3,) [N]."""
        return self._factor(t) * np.asarray(self.force, dtype=np.float64)

    def torque_at(self, t: float) -> npt.NDArray[np.float64]:
        """Torque at t, shape (3,) [N m]."""
        return self._factor(t) * np.asarray(self.torque, dtype=np.float64)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Ends of the window and declared breakpoints of the time function [s]."""
        kinks = getattr(self.time, "breakpoints", ())
        return (*super().breakpoints, *(t for t in kinks if self.since < t < self.until))


def next_breakpoint(breakpoints: Sequence[float], t: float, resolution: float) -> float:
    """First of the sorted breakpoints later than t by more than the resolution [s], or infinity."""
    k = bisect_right(breakpoints, t + resolution)
    return breakpoints[k] if k < len(breakpoints) else inf

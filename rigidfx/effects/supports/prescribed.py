"""Nodes that are moved along a path, or turned about an axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from math import isfinite
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import direction, is_function, numbers, scalar, shown, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.base import Vector
from rigidfx.effects.fields import PlaceAndTime, of_place, values_at
from rigidfx.effects.supports.path_velocity import PathAndVelocity
from rigidfx.effects.supports.support import Support, slope_after

__all__ = ["PrescribedMotion", "PrescribedRotation"]


@dataclass(frozen=True)
class GuidedSupport(Support):
    """Refuses a velocity that is not the derivative of the path, where a run would use it."""

    moves: ClassVar[bool] = True
    functions: ClassVar[tuple[str, str]]  # fields of its path, and of the derivative or None

    def __post_init__(self) -> None:
        """Raise `SceneError` if window, components, path or derivative cannot be used."""
        super().__post_init__()
        for name in self.functions:
            f = getattr(self, name)
            if not is_function(f) and not (name == self.functions[1] and f is None):
                raise SceneError(f"{self.owner}: {name} must be a function of t, got {shown(f)}.")

    @property
    def path_and_velocity(self) -> PathAndVelocity | None:
        """Path and given velocity, of held nodes; None without such a velocity."""
        raise NotImplementedError

    def check(self, scene: Any) -> None:
        """See whether path and velocity can be used, and go together at the start and at kinks."""
        super().check(scene)
        starts = {self.start, *(t for t in self.breakpoints if self.start < t < self.until)}
        spans = list(pairwise([*sorted(starts), self.until]))

        def compare(both: PathAndVelocity) -> str:
            return next(filter(None, (both.contradiction_at(*s) for s in spans if s[0] < s[1])), "")

        self._refuse(scene, compare)

    def check_run(self, scene: Any, t_end: float) -> None:
        """See whether path and velocity go together in a run."""
        start, end = self.start, min(self.until, t_end)
        if start < end:
            self._refuse(scene, lambda b: b.contradiction_within(start, end, self.breakpoints))

    def _refuse(self, scene: Any, contradiction: Callable[[PathAndVelocity], str]) -> None:
        """Refuse a contradiction of path and velocity. Collective."""
        both = self.path_and_velocity

        def compare() -> None:
            if both is not None and (wrong := contradiction(both)):
                raise SceneError(
                    f"{self.owner}: {wrong}. Give the path's derivative, or no velocity at all."
                )

        together(scene.comm, f"{self.owner}: its path or velocity", compare)


@dataclass(frozen=True)
class PrescribedMotion(GuidedSupport):
    """Moves the nodes of a named set along a given path, from where they are at its start.

    Attributes:
        displacement: Function t → three components of the displacement [m], or function x, t of
            reference positions of shape (3, n) too, which gives shape (3, n); only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s], of the same arguments; by a one-sided second-order
            difference if None. It is used at the start of the motion and after each breakpoint.
            A wrong derivative is an error: path and velocity are compared at one node.
    """

    functions: ClassVar[tuple[str, str]] = "displacement", "velocity"

    displacement: PlaceAndTime = field(kw_only=True)
    velocity: PlaceAndTime | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if window, components or functions cannot be used."""
        super().__post_init__()
        if self.velocity is not None and of_place(self.velocity) == self.uniform:
            raise SceneError(
                f"{self.owner}: displacement and velocity must be functions of the same "
                "arguments, t or x, t."
            )

    @cached_property
    def uniform(self) -> bool:  # type: ignore[override]
        """Whether all its nodes move alike: the path is a function of time alone."""
        return not of_place(self.displacement)

    def displacements_at(self, t: float, X: Array) -> Array:
        """The path of some points at t, shape (3,) or (points, 3) [m]."""
        return self._values(self.displacement, t, X)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """The given velocity of some points at t, or the slope of their path just after t."""
        if self.velocity is not None:
            return self._values(self.velocity, t, X)
        return np.asarray(slope_after(partial(self.displacements_at, X=X), t, dt))

    def _values(self, function: Any, t: float, X: Array) -> Array:
        return numbers(function(t)) if self.uniform else values_at(function, X, t)

    def same_motion(self, other: Support) -> bool:
        """The same path and the same velocity, given by the same functions."""
        return (
            isinstance(other, PrescribedMotion)
            and other.displacement == self.displacement
            and other.velocity == self.velocity
        )

    @property
    def path_and_velocity(self) -> PathAndVelocity | None:
        """Path and given velocity, of the held components; None without such a velocity."""
        if self.velocity is None:
            return None
        X = self.points[:1]
        return PathAndVelocity(
            lambda t: self.displacements_at(t, X).ravel(),
            lambda t: self.velocities_at(t, 1.0, X, X).ravel(),
            self.axes,
        )

    def signal(self, t: float, dt: float) -> Array:
        """The velocity, while it acts."""
        some = self.points
        if not self.acts(t):
            return np.zeros(some.size)
        velocities = self.velocities_at(t, dt, some, some)
        return np.asarray(np.broadcast_to(velocities, some.shape)).ravel()


@dataclass(frozen=True)
class PrescribedRotation(GuidedSupport):
    """Rotates the nodes of a named set about a fixed axis, from their positions at its start.

    In a step from t₀ to t₁ a node at x moves by (R(φ(t₁) - φ(t₀)) - I) (x - c), with c
    a point of the axis. Its work is force times path, so energy balances for any Δt. The velocity
    of its nodes is 2 Δu/Δt minus the one before, as at all nodes: it alternates about ω × r with
    the relative amplitude (ωΔt)²/12. Reactions do not, but for vibrating parts: `ResolvedForces`.

    Attributes:
        axis: Direction of the axis, of any length; the angle counts by the right hand.
        through: A point of the axis, c [m].
        angle: Function t → φ [rad], such as a `Table`; only its increments count. An attribute
            `breakpoints` of it names the instants of its kinks.
        speed: Its derivative [rad/s]; by a one-sided second-order difference if None. Both are
            compared, as the path and the velocity of a `PrescribedMotion` are.
    """

    uniform: ClassVar[bool] = False
    functions: ClassVar[tuple[str, str]] = "angle", "speed"
    checks: ClassVar[Checks] = {"axis": direction, "through": vector}

    axis: Vector = field(kw_only=True)
    through: Vector = field(default=(0.0, 0.0, 0.0), kw_only=True)
    angle: Callable[[float], float] = field(kw_only=True)
    speed: Callable[[float], float] | None = field(default=None, kw_only=True)

    @property
    def direction(self) -> Array:
        """Unit vector along the axis."""
        return direction(self.kind, "axis", self.axis)

    def _asked(self, name: str, t: float) -> float:
        """Angle or speed at t."""
        given = getattr(self, name)(t)
        value = scalar(given)
        if not isfinite(value):
            raise SceneError(
                f"{self.owner}: at t = {t:g} s {name} must be a finite number, got {shown(given)}."
            )
        return value

    def angular_velocity(self, t: float, dt: float) -> Array:
        """ω just after t, shape (3,) [rad/s]."""
        if self.speed is not None:
            return self._asked("speed", t) * self.direction
        return slope_after(partial(self._asked, "angle"), t, dt) * self.direction

    @property
    def path_and_velocity(self) -> PathAndVelocity | None:
        """The angle and the given speed, as vectors along the axis."""
        if self.speed is None:
            return None
        asked, axis = self._asked, self.direction
        of = lambda t: asked("angle", t) * axis, lambda t: asked("speed", t) * axis
        return PathAndVelocity(*of, (0, 1, 2), "rad")

    def displacements_at(self, t: float, X: Array) -> Array:
        """(R - I)(X - c) of some points, shape (points, 3) [m]."""
        return self._turned(self._asked("angle", t), X)

    def increments_of(self, t0: float, t1: float, X: Array, x: Array) -> Array:
        """(R(φ₁ - φ₀) - I)(x - c) of some points, shape (points, 3) [m]."""
        return self._turned(self._asked("angle", t1) - self._asked("angle", t0), x)

    def _turned(self, angle: float, x: Array) -> Array:
        arms = x - np.asarray(self.through)
        turn = Rotation.from_rotvec(angle * self.direction)
        return np.asarray(turn.apply(arms) - arms).reshape(-1, 3)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """ω × (x - c) of some points just after t, shape (points, 3) [m/s]."""
        return np.cross(self.angular_velocity(t, dt), x - np.asarray(self.through))

    @property
    def keeps_rigid(self) -> bool:
        """True: a rotation strains nothing."""
        return True

    def same_motion(self, other: Support) -> bool:
        """The same angle about the same axis."""
        return (
            isinstance(other, PrescribedRotation)
            and (other.angle, other.speed) == (self.angle, self.speed)
            and np.array_equal(other.direction, self.direction)
            and not np.cross(np.subtract(other.through, self.through), self.direction).any()
        )

    def signal(self, t: float, dt: float) -> Array:
        """The angular velocity, while it acts."""
        return self.angular_velocity(t, dt) if self.acts(t) else np.zeros(3)

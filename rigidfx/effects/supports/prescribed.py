"""Nodes that are moved along a path, or turned about an axis.

Supports that follow a user's path: is a velocity given beside it its derivative?

Neither is known but at instants that are asked for, and so is not the time in which they change.
One-sided difference quotients over several spans are compared with the velocity, as far as rounding
leaves them two digits, and over no span in which the path goes there and back. The velocity is
right where one of them comes near it. The measure is the largest velocity near by, not the one at
the same instant, which may vanish there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import pairwise
from math import isfinite
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from rigidfx.base.errors import SceneError, together
from rigidfx.base.inputs import direction, numbers, of_time, scalar, shown, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array
from rigidfx.effects.base import NO_VECTOR, PlaceAndTime, Vector, of_place, values_at
from rigidfx.effects.supports.support import Support, slope_after


@dataclass(frozen=True)
class GuidedSupport(Support):
    """Refuses a velocity that is not the derivative of the path, where a run would use it."""

    moves: ClassVar[bool] = True

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

    checks: ClassVar[Checks] = {"displacement": of_time, "velocity": of_time}

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
    checks: ClassVar[Checks] = {
        "axis": direction,
        "through": vector,
        "angle": of_time,
        "speed": of_time,
    }

    axis: Vector = field(kw_only=True)
    through: Vector = field(default=NO_VECTOR, kw_only=True)
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


AT_START = 1e-2  # of the largest velocity: nodes get the velocity of the start
LATER = 5e-2  # of it: a path may be a polygon and the velocity that of the curve it stands for
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements
SPANS = 10.0 ** -np.arange(1, 10)  # s
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples hit no period and no round number
EVENLY, EARLY = 17, 7  # instants spread over a run, and ever closer to its start


@dataclass(frozen=True)
class PathAndVelocity:
    """A path and a velocity as functions of time, and the components that count.

    Attributes:
        path: Function t → displacement, shape (3,) [m].
        velocity: Function t → velocity, shape (3,) [m/s].
        axes: The components that are compared.
        unit: That of the path, for messages.
    """

    path: Callable[[float], Array]
    velocity: Callable[[float], Array]
    axes: tuple[int, ...]
    unit: str = "m"

    def contradiction_at(self, t: float, end: float) -> str:
        """Contradiction of velocity and path just after t, before an end [s]; "" if none."""
        wrong = self._wrong(np.array([t]), np.array([end]), AT_START)
        return wrong[0][1] if wrong else ""

    def contradiction_within(self, start: float, end: float, kinks: Sequence[float]) -> str:
        """Contradiction at several instants between start and end [s]; "" if none.

        No quotient straddles a kink. At one instant alone an unnamed kink may be the cause, so that
        takes two of them.
        """
        shares = np.append(
            (0.5 + GOLDEN * np.arange(EVENLY)) % 1, GOLDEN * 10.0 ** -np.arange(EARLY)
        )
        instants = start + (end - start) * shares
        ends = np.array([*sorted(k for k in kinks if start < k < end), end])
        after = np.minimum(np.searchsorted(ends, instants, side="right"), len(ends) - 1)
        wrong = self._wrong(instants, ends[after], LATER)
        return max(wrong)[1] if len(wrong) > 1 else ""

    def _wrong(self, t: Array, ends: Array, share: float) -> list[tuple[float, str]]:
        """By how much quotients before the ends of instants are off the velocity, and in words.

        Only instants count where all are off by more than a share of the largest velocity [m/s].
        """
        h = np.minimum(SPANS, 0.5 * (ends - t)[:, None])
        at = t[:, None]
        v, u = self._of(self.velocity, at), self._of(self.path, at)
        u1, u2 = self._of(self.path, at + h), self._of(self.path, at + 2 * h)
        quotients = (4 * u1 - 3 * u - u2) / (2 * h[..., None])
        gained = np.abs(u1 - u).max(axis=2)
        noise = ROUNDING * (np.abs(u).max(axis=2) + gained * (1 + np.abs(at) / h)) / h
        speeds, way = np.nan_to_num(gained / h - noise), np.nan_to_num(gained)
        fastest = max(float(speeds.max()), 0.0)
        tolerance = share * max(fastest, float(np.nan_to_num(np.abs(v)).max()))
        known = (noise <= tolerance) & (h * fastest <= max(float(way.max()), float(h.min())))
        off = np.abs(quotients - v).max(axis=2)
        off = np.where(known & np.isfinite(off), off, np.inf)
        best, rows = off.argmin(axis=1), np.arange(len(t))
        wrong = np.flatnonzero((off[rows, best] > tolerance) & np.isfinite(off[rows, best]))
        return [
            (float(off[k, best[k]]), self._words(t[k], v[k, 0], quotients[k, best[k]]))
            for k in wrong
        ]

    def _of(self, function: Callable[[float], Array], t: Array) -> Array:
        """The components that count, shape (*t, components); NaN where a function is not defined.

        A step would tell of that.
        """

        def value(t: float) -> Array:
            try:
                found = function(t)
            except Exception:  # whatever a user's function may raise
                found = np.empty(0)
            return found[list(self.axes)] if np.shape(found) == (3,) else none

        none = np.full(len(self.axes), np.nan)
        return np.array([value(float(each)) for each in t.flat]).reshape(*t.shape, -1)

    def _words(self, t: float, v: Array, q: Array) -> str:
        names = "".join("xyz"[axis] for axis in self.axes)
        along = "" if names == "xyz" else f" along {', '.join(names)}"
        unit = f"{self.unit}/s"
        return f"at t = {t:g} s its velocity is {v} {unit}{along}, and its path moves by {q} {unit}"

"""Supports: what holds the nodes of a set, moves them along a path, or turns them about an axis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
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
from rigidfx.effects.base import (
    NO_VECTOR,
    Effect,
    PlaceAndTime,
    Vector,
    Windowed,
    of_place,
    values_at,
)

FLAT = 1e-9  # of the size of the mesh: extent of a plane along its normal
AT_START = 1e-2  # of the largest velocity: nodes get the velocity of the start
LATER = 5e-2  # of it: a path may be a polygon and the velocity that of the curve it stands for
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples hit no period and no round number
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements
SPANS = 10.0 ** -np.arange(1, 10)  # s
EVENLY, EARLY = 17, 7  # instants spread over a run, and ever closer to its start


@dataclass(frozen=True)
class PathAndVelocity:
    """A path and a velocity as functions of time, and the components that count.

    Both are known only at instants that are asked for. One-sided difference quotients over several
    spans are compared with the velocity, as far as rounding leaves them two digits, and over no
    span in which the path goes there and back. The velocity is right where one of them comes near
    it. The measure is the largest velocity near by, as the one at the same instant may vanish.
    """

    path: Callable[[float], Array]  # t → displacement, shape (3,) [m]
    velocity: Callable[[float], Array]  # t → velocity, shape (3,) [m/s]
    axes: tuple[int, ...]
    unit: str = "m"  # that of the path, for messages

    def contradictions(self, t: Array, ends: Array, share: float) -> list[tuple[float, str]]:
        """By how much quotients from instants to before their ends are off the velocity, in words.

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
        """The components that count, shape (*t, components); NaN where a function has no value."""

        def value(t: float) -> Array:
            try:
                found = function(t)
            except Exception:  # whatever a user's function may raise; a step would tell of it
                found = np.empty(0)
            return found[list(self.axes)] if np.shape(found) == (3,) else none

        none = np.full(len(self.axes), np.nan)
        return np.array([value(float(each)) for each in t.flat]).reshape(*t.shape, -1)

    def _words(self, t: float, v: Array, q: Array) -> str:
        names = "".join("xyz"[axis] for axis in self.axes)
        along = "" if names == "xyz" else f" along {', '.join(names)}"
        unit = f"{self.unit}/s"
        return f"at t = {t:g} s its velocity is {v} {unit}{along}, and its path moves by {q} {unit}"


def slope_after(path: Callable[[float], Any], t: float, dt: float) -> Any:
    """One-sided difference quotient of second order just after t [s], by a thousandth of dt [s]."""
    h = 1e-3 * dt
    u0, u1, u2 = (path(t + k * h) for k in range(3))
    return (4 * u1 - 3 * u0 - u2) / (2 * h)


@dataclass(frozen=True)
class Support(Windowed):
    """Prescribes components of the motion of a named set's nodes.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        components: Which of the components x, y, z are held, for example "xz".
    """

    is_load: ClassVar[bool] = True
    is_support: ClassVar[bool] = True
    holds: ClassVar[bool] = True
    moves: ClassVar[bool] = False  # whether its motion is a user's function of time
    uniform: ClassVar[bool] = True  # whether all its nodes move alike
    path_and_velocity: ClassVar[Any] = None  # of held nodes; None without a given velocity
    bends: ClassVar[Mapping[float, float]] = {}  # a kink of a path is a jump of the velocity

    where: str
    components: str = "xyz"

    def __post_init__(self) -> None:
        """Raise `SceneError` unless components names some of x, y, z once each."""
        super().__post_init__()
        c = self.components
        if not isinstance(c, str) or not c or set(c) - set("xyz") or len(set(c)) != len(c):
            raise SceneError(
                f"{self.owner}: components must be some of 'xyz', each once, got {shown(c)}."
            )

    @property
    def axes(self) -> tuple[int, ...]:
        """The held components as numbers 0, 1, 2."""
        return tuple("xyz".index(c) for c in self.components)

    def displacements_at(self, t: float, X: Array) -> Array:
        """Prescribed displacements of points X at t [s], up to a constant of no consequence.

        Shape (3,), or (points, 3) where they are not `uniform` [m]; zero of one at rest.
        """
        return np.zeros(3)

    def increments_of(self, t0: float, t1: float, X: Array, x: Array) -> Array:
        """Prescribed increments from t0 to t1 of points X, at x at t0, shape (points, 3) [m]."""
        return self.displacements_at(t1, X) - self.displacements_at(t0, X)

    def velocities_at(self, t: float, dt: float, X: Array, x: Array) -> Array:
        """Prescribed velocities of points just after t [s], likewise [m/s].

        Reference positions are X, places at t are x; dt scales a difference quotient [s].
        """
        return np.zeros(3)

    def path_at(self, t: float) -> Array:
        """Its path in the components held, of all its nodes or some; equal on all ranks [m]."""
        return np.asarray(self.displacements_at(t, self.points)[..., list(self.axes)]).ravel()

    @property
    def keeps_rigid(self) -> bool:
        """Whether it may take a part named rigid along: its motion strains nothing."""
        return self.uniform

    def same_motion(self, other: Support) -> bool:
        """Whether both prescribe the same motion, as at rest, so that they may share nodes."""
        return not (self.moves or other.moves)

    def check(self, scene: Any) -> None:
        """See whether its motion can be used; path and velocity go together at its kinks."""
        self.check_functions(
            scene,
            lambda: next(nodes for support, nodes in scene.supports if support is self),
            lambda X: self.displacements_at(self.start, X),
            lambda X: self.velocities_at(self.start, 1.0, X, X),
        )
        starts = {self.start, *(t for t in self.breakpoints if self.start < t < self.until)}
        spans = pairwise([*sorted(starts), self.until])
        looks = ((np.array([t]), np.array([end]), AT_START) for t, end in spans if t < end)
        self._refuse(scene, looks, 1)

    def check_run(self, scene: Any, t_end: float) -> None:
        """Raise `SceneError` on every rank if its motion cannot be used in a run. Collective.

        Path and velocity are compared at several instants. No quotient straddles a kink. At one
        instant alone an unnamed kink may be the cause, so that a contradiction takes two of them.
        """
        start, end = self.start, min(self.until, t_end)
        shares = (0.5 + GOLDEN * np.arange(EVENLY)) % 1, GOLDEN * 10.0 ** -np.arange(EARLY)
        instants = start + (end - start) * np.concatenate(shares)
        ends = np.array([*sorted(k for k in self.breakpoints if start < k < end), end])
        after = np.minimum(np.searchsorted(ends, instants, side="right"), len(ends) - 1)
        if start < end:
            self._refuse(scene, [(instants, ends[after], LATER)], 2)

    def _refuse(self, scene: Any, looks: Iterable[tuple[Array, Array, float]], least: int) -> None:
        """Refuse a velocity that is wrong at `least` instants of a look, or more. Collective."""
        if (both := self.path_and_velocity) is None:
            return

        def compare() -> None:
            for look in looks:
                if len(wrong := both.contradictions(*look)) >= least:
                    raise SceneError(
                        f"{self.owner}: {max(wrong)[1]}. Give the path's derivative, or no "
                        "velocity at all."
                    )

        together(scene.comm, f"{self.owner}: its path or velocity", compare)


@dataclass(frozen=True)
class Fixed(Support):
    """Holds the nodes of a named set where they are when the window begins."""


@dataclass(frozen=True)
class Symmetry(Fixed):
    """Holds the nodes of a plane in the direction of its normal, which is x, y or z.

    It is the plane of the nodes after an `InitialDisplacement`.

    Loads, reactions and energies are those of the modelled half. Give half of a force that acts in
    the plane itself. A `RigidFace` that the plane cuts, such as half of a hole, moves along the
    plane and turns about its normal only. A joint of the name "Symmetry on 'plane' - RigidFace
    'hole'" holds it, and tells its force.

    Attributes:
        components: The normal: found by the scene.
    """

    components: str = field(default="xyz", init=False)

    def placed(self, scene: Any) -> Symmetry:
        """The same with the normal of its plane at the start; else a `SceneError`. Collective."""
        nodes = scene.nodes(self.where, self.kind, (2,))
        X = scene.start_places[nodes]
        low, high = scene.box_of(X)
        extent = high - low
        size = float(np.max(np.nan_to_num(extent, posinf=0.0, neginf=0.0)))
        flat = np.flatnonzero(extent <= FLAT * max(size, np.abs([low, high]).max()))
        if len(flat) != 1:
            raise SceneError(
                f"{self.owner}: its facets must lie in one plane whose normal is x, y or z; they "
                f"reach from {tuple(low.tolist())} to {tuple(high.tolist())} m at the start."
            )
        return self._with(components="xyz"[int(flat[0])])


@dataclass(frozen=True)
class ResolvedForces(Effect):
    """Reactions, forces of joints and torques of motors without vibration faster than Δt.

    Flexible parts that start or are struck vibrate in all frequencies that their cells have. Those
    far above 1/Δt alternate from step to step for ever, and reactions with them. With this effect
    reports, files and peaks have the forces of the motion that Δt resolves: of a vibration with n
    steps a period 0.99 at n = 10, 0.997 at 13. The motion, its energy and its work stay as they
    are; `report.impulse` has the rest. Each step takes one tangent, with its factors, more.
    """


@dataclass(frozen=True)
class PrescribedMotion(Support):
    """Moves the nodes of a named set along a given path, from where they are at its start.

    Attributes:
        displacement: Function t → three components of the displacement [m], or function x, t of
            reference positions of shape (3, n) too, which gives shape (3, n); only its increments
            count. An attribute `breakpoints` of it names the instants of its kinks.
        velocity: Its derivative [m/s], of the same arguments; by a one-sided second-order
            difference if None. It is used at the start of the motion and after each breakpoint.
            A wrong derivative is an error: path and velocity are compared at one node.
    """

    moves: ClassVar[bool] = True
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
        """Whether path and velocity are given by the same functions."""
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
class PrescribedRotation(Support):
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

    moves: ClassVar[bool] = True
    uniform: ClassVar[bool] = False
    keeps_rigid: ClassVar[bool] = True
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

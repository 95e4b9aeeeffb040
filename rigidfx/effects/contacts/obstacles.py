"""Obstacles, which do not deform, at rest or moving along a path, and contact with them.

The gap of a point is taken in a variable that is at most quadratic in its position relative to the
obstacle, so that its increment in a step is an exact product m·Δy. docs/theory/contact.md has m of
each obstacle, the secant [U] of the penalty, and friction. Its t = Δg_T/√(|Δg_T|² + (ε Δt)²) is an
additional unknown, kept from iterate to iterate with |t| ≤ 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import SceneError, by_name
from rigidfx.base.inputs import direction, numbers, of_time, positive, shown, truth, vector
from rigidfx.base.taken import Checks, check_fields, take_fields
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure, Touch
from rigidfx.effects.base import Vector, vector_at
from rigidfx.effects.contacts.surface import (
    CLOSED,
    ContactForces,
    ContactSurface,
    Pressed,
    secant,
    soonest,
)
from rigidfx.effects.nodes import Instant, Motion, Nodes, Tangent
from rigidfx.mechanics.rotation import IDENTITY

TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class Approach:
    """How the gaps of points change in a step: g₁ = g₀ + m·Δy."""

    m: Array  # directions, shape (n, 3); of length one but for curved obstacles
    dm: Array | None  # their derivatives by y₁, shape (n, 3, 3) [1/m]; zero, for all, if None
    dg: Array  # derivatives of g₁ by y₁, shape (n, 3)


@dataclass(frozen=True)
class Obstacle:
    """The base of all obstacles.

    Attributes:
        path: Function t → three components of its displacement [m], for one that moves; None for
            one at rest. An attribute `breakpoints` of it names the instants of its kinks.
    """

    checks: ClassVar[Checks] = {"path": of_time}

    path: Callable[[float], Vector] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Copy the values; raise `SceneError` if one cannot be used."""
        take_fields(self)
        check_fields(self, self.checks)

    @property
    def kind(self) -> str:
        """Its name."""
        return type(self).__name__

    @property
    def breakpoints(self) -> Any:
        """Instants of the kinks of its path [s]."""
        return getattr(self.path, "breakpoints", ())

    def displacement(self, t: float) -> Array:
        """How far it has moved at t [s], shape (3,) [m]."""
        return np.zeros(3) if self.path is None else numbers(self.path(t))

    def gap(self, y: Array) -> Array:
        """Distances of points y, shape (n, 3), less its displacement; negative inside, (n,) [m]."""
        raise NotImplementedError

    def outward(self, y: Array) -> Array:
        """Directions in which the gap grows, shape (n, 3)."""
        raise NotImplementedError

    def approach(self, y0: Array, y1: Array) -> Approach:
        """How gaps change from y0 to y1, shapes (n, 3) [m]."""
        raise NotImplementedError

    def asked(self, owner: str, name: str, *points: Array) -> Any:
        """What its gap, outward or approach gives; it may be of a user's own. The owner is named.

        `SceneError` on this rank, if it fails, or is not finite at points that are.
        """
        what, y = f"{name} of the {self.kind}", points[-1]
        found = by_name(owner, None, lambda: getattr(self, name)(*points), what)
        given = [(found, y.shape if name == "outward" else y.shape[:1])]
        if name == "approach":
            if not isinstance(found, Approach):
                raise SceneError(f"{owner}: {what} must give an Approach, got {shown(found)}.")
            curved = [] if found.dm is None else [(found.dm, (*y.shape, 3))]
            given = [(found.m, y.shape), (found.dg, y.shape), *curved]
        for part, shape in given:
            if np.shape(part) != shape or (np.isfinite(y).all() and not np.isfinite(part).all()):
                raise SceneError(
                    f"{owner}: {what} must give finite numbers of shape {shape} for points of "
                    f"shape {y.shape}, got {shown(part)}."
                )
        return found

    def __str__(self) -> str:
        """Its kind, in words of a table."""
        return self.kind if self.path is None else f"moving {self.kind}"


@dataclass(frozen=True)
class Plane(Obstacle):
    """A plane that keeps points on the side its normal points to.

    Attributes:
        point: Any point of it [m].
        normal: Its normal, of any length.
    """

    checks: ClassVar[Checks] = Obstacle.checks | {"point": vector, "normal": direction}

    point: Vector
    normal: Vector

    @cached_property
    def _n(self) -> Array:
        return direction(self.kind, "normal", self.normal)

    def gap(self, y: Array) -> Array:
        """Distance along the normal, shape (n,) [m]."""
        return np.asarray((y - np.asarray(self.point)) @ self._n)

    def outward(self, y: Array) -> Array:
        """The normal."""
        return np.broadcast_to(self._n, y.shape)

    def approach(self, y0: Array, y1: Array) -> Approach:
        """m = n."""
        n = self.outward(y0)
        return Approach(n, None, n)


@dataclass(frozen=True)
class Round(Obstacle):
    """The common part of sphere and cylinder: a centre, a radius and an inside.

    Attributes:
        centre: Centre of the sphere, or any point of the axis [m].
        radius: Radius [m].
        inside: Whether points are kept inside instead of outside.
    """

    checks: ClassVar[Checks] = Obstacle.checks | {
        "centre": vector,
        "radius": positive,
        "inside": truth,
    }

    centre: Vector
    radius: float
    inside: bool = field(default=False, kw_only=True)

    @property
    def _sign(self) -> float:
        return -1.0 if self.inside else 1.0

    @cached_property
    def _P(self) -> Array:
        return np.eye(3)

    def _arms(self, y: Array) -> Array:
        return np.asarray((y - np.asarray(self.centre)) @ self._P)

    def gap(self, y: Array) -> Array:
        """Distance from the surface, shape (n,) [m]."""
        distance = np.linalg.norm(self._arms(y), axis=1)
        return np.asarray(self._sign * (distance - self.radius))

    def outward(self, y: Array) -> Array:
        """Directions away from centre or axis, or towards it."""
        z = self._arms(y)
        length = np.maximum(np.linalg.norm(z, axis=1, keepdims=True), TINY)
        return np.asarray(self._sign * z / length)

    def approach(self, y0: Array, y1: Array) -> Approach:
        """m = ± 2 z½/(|z₀| + |z₁|)."""
        z0, z1 = self._arms(y0), self._arms(y1)
        ends = np.linalg.norm(z0, axis=1), np.linalg.norm(z1, axis=1)
        both = np.maximum(ends[0] + ends[1], TINY)[:, None]
        m = self._sign * (z0 + z1) / both
        end = z1 / np.maximum(ends[1], TINY)[:, None]
        dm = (self._sign * self._P - m[:, :, None] * end[:, None]) / both[:, :, None]
        return Approach(m, dm, self._sign * end)


@dataclass(frozen=True)
class Sphere(Round):
    """A sphere, or a hollow one that keeps points inside."""


@dataclass(frozen=True)
class Cylinder(Round):
    """An infinite circular cylinder, or a tube that keeps points inside.

    Attributes:
        axis: Direction of its axis, of any length.
    """

    checks: ClassVar[Checks] = Round.checks | {"axis": direction}

    axis: Vector = (0.0, 0.0, 1.0)

    @cached_property
    def _P(self) -> Array:
        a = direction(self.kind, "axis", self.axis)
        return np.asarray(np.eye(3) - np.outer(a, a))


@dataclass(frozen=True)
class Friction:
    """Coulomb friction in a step."""

    mu: float
    slip: float  # ε Δt, below which points creep [m]
    beside: Array | None = None  # how far each slides beside its partner, shape (points, 3) [m]
    part: float = 1.0  # part of its motion that counts as a slide


@dataclass(frozen=True)
class Sliding:
    """How pressed points slide at an iterate."""

    friction: Friction
    n: Array  # normals, shape (n, 3)
    length: Array  # |m|, shape (n,)
    slid: Array  # Δg_T, shape (n, 3) [m]
    root: Array  # √(|Δg_T|² + (ε Δt)²), shape (n,) [m]
    t: Array  # stand-in for Δg_T over that in derivatives, shape (n, 3)


@dataclass(frozen=True)
class Touched(Pressed):
    """Points that an obstacle presses at an iterate."""

    moved: Array  # Δy, shape (n, 3) [m]
    approach: Approach
    sliding: Sliding | None  # None without friction

    @property
    def grip(self) -> Array:
        """Friction over Δg_T, shape (n,) [N/m]."""
        if (s := self.sliding) is None:
            return np.zeros(len(self.at))
        return -s.friction.mu * self.value * s.length / s.root

    @property
    def force(self) -> Array:
        """Resistance, shape (n, 3) [N]."""
        force = self.value[:, None] * self.approach.m
        return force if self.sliding is None else force + self.grip[:, None] * self.sliding.slid

    @property
    def dissipated(self) -> float:
        """Energy that friction takes [J]."""
        if (s := self.sliding) is None:
            return 0.0
        return float(self.grip @ (s.slid * s.slid).sum(axis=1))

    @property
    def stiffness(self) -> Array:
        """Derivative of the resistance by y₁, shape (n, 3, 3) [N/m]."""
        a = self.approach
        out = self.slope[:, None, None] * a.m[:, :, None] * a.dg[:, None]
        if a.dm is not None:
            out = out + self.value[:, None, None] * a.dm
        return out if self.sliding is None else out + self._of_friction(self.sliding)

    def _of_friction(self, s: Sliding) -> Array:
        value, slope, a = self.value, self.slope, self.approach
        n, length = s.n, s.length
        along = np.einsum("ni,ni->n", n, self.moved)
        # How N, and Δg_T, change with y₁.
        dN = -(slope * length)[:, None] * a.dg
        dg = IDENTITY - n[:, :, None] * n[:, None]
        if a.dm is not None:
            dlength = np.einsum("ni,nij->nj", n, a.dm)
            dN = dN - value[:, None] * dlength
            dn = (a.dm - n[:, :, None] * dlength[:, None]) / length[:, None, None]
            of_n = np.einsum("ni,nij->nj", self.moved, dn)
            dg = dg - n[:, :, None] * of_n[:, None] - along[:, None, None] * dn
        direction = s.slid / s.root[:, None]
        across = IDENTITY - s.t[:, :, None] * direction[:, None]
        across *= s.friction.part
        N = -value * length
        # In statics points that have just closed stick, as if N/|slip| were their stiffness.
        N = np.where(2.0 * TINY * slope < N, N, slope * s.root)
        turned = (N / s.root)[:, None, None] * (across @ dg)
        return np.asarray(s.friction.mu * (direction[:, :, None] * dN[:, None] + turned))


NONE, FEW = np.empty((0, 3)), np.empty(0)
NOTHING = Touched(
    np.empty(0, np.int64), (FEW, FEW), FEW, FEW, NONE, Approach(NONE, None, NONE), None
)


class ObstacleForces(ContactForces):
    """The forces of an obstacle on the nodes and bodies of a division."""

    def __init__(
        self, effect: Any, obstacle: Obstacle, surface: ContactSurface, structure: Structure
    ) -> None:
        """Find the nodes of the surface. Collective."""
        k = surface.stiffness[: structure.scene.owned_nodes]
        self.nodes = nodes = Nodes(structure, np.flatnonzero(k > 0))
        super().__init__(effect, k[nodes.nodes], structure)
        self._effect, self._obstacle = effect, obstacle
        self._ask: Callable[..., Any] = partial(obstacle.asked, effect.owner)
        self._y0: Array = np.zeros((len(nodes), 3))  # from the obstacle at the start of a step [m]
        self._g0: Array = np.zeros(len(nodes))  # gaps there [m]
        self._before = self._y0, self._y0, self._g0
        self._ends: Array = np.zeros((2, 3))  # displacements of the obstacle
        self._dt, self._friction = 0.0, effect.friction_in(0.0)
        self._began: Instant | None = None  # where a longer motion began ...
        self._obstacle_went: Array = np.zeros(3)  # ... and how far the obstacle has gone [m]
        square = structure.scene.comm.allreduce(float(k @ k), op=MPI.SUM)
        self.rounding = float(np.sqrt(square)) * nodes.far()

    def set_time(self, t: float, dt: float) -> None:
        """Place the obstacle at both ends of a step; in statics t is the end of the step."""
        before, after = (dt, 0.0) if self._static else (dt / 2, dt / 2)
        self._ends = np.stack([self._place(max(t - before, 0.0)), self._place(t + after)])
        self._dt, self._pressed, self._began = dt, None, None
        self._friction = self._effect.friction_in(dt)

    def creep_for(self, time: float, began: Instant) -> None:
        """Let friction be that of a longer motion, in which the obstacle goes as in the step."""
        friction = self._effect.friction_in(time)
        if friction is not None:
            # Of the step itself half counts, as in forces halfway.
            self._friction = replace(friction, part=0.5)
            self._obstacle_went = (time / self._dt - 0.5) * self._moved
            self._pressed, self._began = None, began

    def _place(self, t: float) -> Array:
        path, obstacle = f"path of the {self._obstacle.kind}", self._obstacle
        return vector_at(self._effect.owner, path, t, lambda: obstacle.displacement(t))

    @property
    def _moved(self) -> Array:
        return np.asarray(self._ends[1] - self._ends[0])

    def _begin(self, motion: Motion) -> None:
        nodes, friction = self.nodes, self._friction
        if friction is not None and self._began is not None:
            went = nodes.displacement(motion.start) - nodes.displacement(self._began)
            self._friction = replace(friction, beside=went - self._obstacle_went)
        self._y0 = nodes.positions(motion.start) - self._ends[0]
        self._g0 = self._ask("gap", self._y0)
        # Of the last iterate: t, slid and root; infinite before, which gives t = 0.
        none = np.zeros_like(self._y0)
        self._before = none, none.copy(), np.full(len(nodes), np.inf)

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add the resistance of pressed nodes."""
        if self._pressed is None:
            self._begin(motion)
        pressed = self._pressed = self._press(self.nodes.moved(motion) - self._moved)
        if pressed.at.size:
            force = np.zeros_like(self._y0)
            force[pressed.at] = pressed.force
            self.nodes.add(force, forces)

    def _press(self, moved: Array) -> Touched:
        """The forces at an iterate, at which points have moved by Δy, shape (n, 3) [m]."""
        y0, y1, g0 = self._y0, self._y0 + moved, self._g0
        g = g1 = self._ask("gap", y1)
        if self._static:  # both ends are the last one; what rounds to closed is stiff at once
            y0 = y1
            g0 = g1 = np.where(g1 <= CLOSED * np.abs(y1).max(axis=1), np.minimum(g1, -TINY), g1)
        at = np.flatnonzero((g0 < 0) | (g1 < 0))
        if not at.size:
            return NOTHING
        approach = self._ask("approach", y0[at], y1[at])
        value, slope = secant(self._k[at], g0[at], g1[at], self._static)
        if self._static and approach.dm is not None:  # by both ends, which are alike
            approach = replace(approach, dm=2 * approach.dm)
        sliding = None
        if self._friction is not None:
            sliding = self._sliding(self._friction, at, approach, moved[at])
        return Touched(at, (self._g0[at], g[at]), value, slope, moved[at], approach, sliding)

    def _sliding(self, friction: Friction, at: Ints, approach: Approach, moved: Array) -> Sliding:
        """How points slide; t follows from the linearised system of the last iterate."""
        length = np.linalg.norm(approach.m, axis=1)
        n = approach.m / length[:, None]
        slid = friction.part * moved + (0.0 if friction.beside is None else friction.beside[at])
        slid = slid - n * np.einsum("ni,ni->n", n, slid)[:, None]
        root = np.sqrt((slid * slid).sum(axis=1) + friction.slip**2)
        t, before, size = (values[at] for values in self._before)
        change = np.einsum("ni,ni->n", before, slid - before) / size
        t = (slid - t * change[:, None]) / size[:, None]
        t /= np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1.0)
        for values, now in zip(self._before, (t, slid, root), strict=True):
            values[at] = now
        return Sliding(friction, n, length, slid, root, t)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add the derivative of the resistance at the last iterate."""
        p = self._pressed  # residuals come before tangents
        self.nodes.stiffen(p.stiffness, tangent, p.at)
        self._in_tangent = self._slopes()

    def _gap(self, at: Instant) -> Array:
        return self._ask("gap", self.nodes.positions(at) - self._place(at.t))

    def taken(self, motion: Motion) -> float:
        """Energy that friction takes [J]."""
        return 0.0 if self._pressed is None else self._pressed.dissipated

    def pressing(self) -> tuple[Ints, Array]:
        """Pressed nodes: along the normal, with friction along two tangents too."""
        ways, p = np.zeros((len(self.nodes), 3, 3)), self._pressed
        if p is not None and p.at.size:
            y = self._y0[p.at] + p.moved
            deep = p.at[np.minimum(*p.gaps) < -CLOSED * np.abs(y).max(axis=1)]
            ways[deep, 0] = n = self._ask("outward", self._y0[deep])
            if self._friction is not None:
                ways[deep, 1] = np.cross(n, IDENTITY[np.abs(n).round(6).argmin(axis=1)])
                ways[deep, 2] = np.cross(n, ways[deep, 1])
        return self.nodes.acted(ways)

    def touch(self) -> Touch:
        """Force at the step's midpoint, in statics at its end, and the work of the obstacle."""
        p = self._pressed
        if p is None or not p.at.size:
            return Touch(self.title)
        share = self.nodes.share
        at = (1 - share) * self._ends[0] + share * self._ends[1]
        place = self._y0[p.at] + share * p.moved + at
        out = self._touched(self._k[p.at], p.gaps[1], -p.force, place)
        return replace(out, work=float(out.force @ self._moved), dissipated=p.dissipated)

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """Time until the first gap closes; -1 if a node touches [s]."""
        c0, c1 = (self._place(t) for t in (at.t, at.t + dt))
        y = self.nodes.positions(at) - c0
        w = self.nodes.velocities(v, at.bodies) - (c1 - c0) / dt
        g = self._ask("gap", y)
        if (g < 0).any():
            return -1.0
        return soonest(g, np.einsum("ni,ni->n", self._ask("outward", y), w))

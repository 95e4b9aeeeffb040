"""Contact with an obstacle: penalty by its secant, and Coulomb friction, at nodes of a surface.

With y the position relative to the obstacle, the resistance of a point is

    [U] m + μ N Δg_T/√(|Δg_T|² + (ε Δt)²),    N = -[U] |m|,    Δg_T = (I - n nᵀ) Δy,  n = m/|m|.

Newton's method on the root diverges where a node begins to stick. With t = Δg_T/√ as an additional
unknown, kept from iterate to iterate with |t| ≤ 1, it converges (docs/theory/contact.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure, Touch
from rigidfx.effects.base import vector_at
from rigidfx.effects.contacts.obstacles import TINY, Approach, AskedObstacle, Obstacle
from rigidfx.effects.contacts.surface import CLOSED, ContactForces, ContactSurface, secant, soonest
from rigidfx.effects.motion import Instant, Motion, Tangent
from rigidfx.effects.nodes import Nodes
from rigidfx.mechanics.rotation import IDENTITY


@dataclass(frozen=True)
class Friction:
    """Coulomb friction in a step: μ, and ε Δt below which points creep [m].

    Attributes:
        beside: How far each slides beside its partner, shape (points, 3) [m]; None for nothing.
        part: Part of its motion that counts as a slide.
    """

    mu: float
    slip: float
    beside: Array | None = None
    part: float = 1.0


@dataclass(frozen=True)
class Pressed:
    """The points that an obstacle presses at an iterate, and their resistance, shape (n, 3) [N].

    Attributes:
        at: Which of the points they are.
        moved: Δy, shape (n, 3) [m].
        normal: [U] and its derivative by g₁, shapes (n,) [N] and [N/m].
        sliding: None without friction.
    """

    at: Ints
    force: Array
    moved: Array
    normal: tuple[Array, Array]
    approach: Approach
    sliding: Sliding | None

    @property
    def stiffness(self) -> Array:
        """Derivative of the resistance by y₁, shape (n, 3, 3) [N/m]."""
        (value, slope), a = self.normal, self.approach
        out = slope[:, None, None] * a.m[:, :, None] * a.dg[:, None]
        if a.dm is not None:
            out = out + value[:, None, None] * a.dm
        return out if self.sliding is None else out + self._of_friction(self.sliding)

    def _of_friction(self, s: Sliding) -> Array:
        (value, slope), a = self.normal, self.approach
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

    @property
    def dissipated(self) -> float:
        """Energy that friction takes [J]."""
        if self.sliding is None:
            return 0.0
        s, N = self.sliding, -self.normal[0] * self.sliding.length
        return s.friction.mu * float((N / s.root) @ (s.slid * s.slid).sum(axis=1))


@dataclass(frozen=True)
class Sliding:
    """How pressed points slide at an iterate.

    Attributes:
        n: Normals, shape (n, 3).
        length: |m|, shape (n,).
        slid: Δg_T, shape (n, 3) [m].
        root: √(|Δg_T|² + (ε Δt)²), shape (n,) [m].
        t: Stand-in for Δg_T over that in derivatives, shape (n, 3).
    """

    friction: Friction
    n: Array
    length: Array
    slid: Array
    root: Array
    t: Array


NONE = np.empty((0, 3))
NOTHING = Pressed(
    np.empty(0, np.int64), NONE, NONE, (NONE[:, 0], NONE[:, 0]), Approach(NONE, None, NONE), None
)


class Points:
    """Points with stiffnesses k that an obstacle may press; their memory belongs to one step.

    Attributes:
        y0: Positions relative to the obstacle at the start of the step, shape (n, 3) [m].
        g0: Gaps there, shape (n,) [m].
        pressed: Those that are pressed, at the last iterate; None before the first of a step.
    """

    def __init__(self, obstacle: Any, k: Array, static: bool = False) -> None:
        """Store stiffnesses, shape (n,) [N/m]; static forces are those at the end of a step."""
        self._obstacle, self.k, self._static = obstacle, k, static
        self.begin(np.empty((0, 3)), None)

    def begin(self, y0: Array, friction: Friction | None) -> None:
        """Begin a step, or an attempt at it, at positions relative to the obstacle [m]."""
        self.y0, self._friction = y0, friction
        self.g0 = self._obstacle.gap(y0)
        self.pressed: Pressed | None = None
        # Of the last iterate: t, slid and root; infinite before, which gives t = 0.
        self._before = np.zeros_like(y0), np.zeros_like(y0), np.full(len(y0), np.inf)

    def press(self, moved: Array) -> Pressed:
        """The forces at an iterate, at which points have moved by Δy, shape (n, 3) [m]."""
        y1 = self.y0 + moved
        y0, g0, g1 = self.y0, self.g0, self._obstacle.gap(y1)
        if self._static:  # both ends are the last one; what rounds to closed is stiff at once
            y0 = y1
            g0 = g1 = np.where(g1 <= CLOSED * np.abs(y1).max(axis=1), np.minimum(g1, -TINY), g1)
        at = np.flatnonzero((g0 < 0) | (g1 < 0))
        if not at.size:
            self.pressed = NOTHING
            return NOTHING
        moved, k = moved[at], self.k[at]
        approach = self._obstacle.approach(y0[at], y1[at])
        value, slope = secant(k, g0[at], g1[at], self._static)
        if self._static and approach.dm is not None:  # by both ends, which are alike
            approach = replace(approach, dm=2 * approach.dm)
        force, sliding = value[:, None] * approach.m, None
        if self._friction is not None:
            sliding = self._sliding(self._friction, at, approach, moved)
            grip = -sliding.friction.mu * value * sliding.length / sliding.root
            force = force + grip[:, None] * sliding.slid
        self.pressed = Pressed(at, force, moved, (value, slope), approach, sliding)
        return self.pressed

    def slopes(self) -> Array:
        """Derivatives of [U] by g₁, and of friction where points stick, shape (2, n) [N/m]."""
        out, p = np.zeros((2, self.k.size)), self.pressed
        if p is not None:
            out[0, p.at] = p.normal[1]
            if p.sliding is not None:
                s = p.sliding
                out[1, p.at] = -s.friction.mu * p.normal[0] * s.length / s.root
        return out

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
        self._asked = AskedObstacle(effect.owner, obstacle)
        self._points = Points(self._asked, self._k, self._static)
        self._ends: Array = np.zeros((2, 3))  # displacements of the obstacle
        self._dt, self._friction = 0.0, effect.friction_in(0.0)
        self._began: Instant | None = None  # where a longer motion began ...
        self._obstacle_went: Array = np.zeros(3)  # ... and how far the obstacle has gone [m]
        square = structure.scene.comm.allreduce(float(k @ k), op=MPI.SUM)
        self.rounding = float(np.sqrt(square)) * nodes.far()

    def set_time(self, t: float, dt: float) -> None:
        """Place the obstacle at both ends of a step; in statics t is the end of the step."""
        before, after = (dt, 0.0) if self._static else (dt / 2, dt / 2)
        began = max(t - before, 0.0)
        self._ends = np.stack([self._displacement(began), self._displacement(t + after)])
        self._dt, self._points.pressed, self._began = dt, None, None
        self._friction = self._effect.friction_in(dt)

    def creep_for(self, time: float, began: Instant) -> None:
        """Let friction be that of a longer motion, in which the obstacle goes as in the step."""
        friction = self._effect.friction_in(time)
        if friction is not None:
            # Of the step itself half counts, as in forces halfway.
            self._friction = replace(friction, part=0.5)
            self._obstacle_went = (time / self._dt - 0.5) * self._moved
            self._points.pressed, self._began = None, began

    def _displacement(self, t: float) -> Array:
        obstacle = self._obstacle
        return vector_at(
            self._effect.owner, f"path of the {obstacle.kind}", t, lambda: obstacle.displacement(t)
        )

    @property
    def _moved(self) -> Array:
        return np.asarray(self._ends[1] - self._ends[0])

    # In each iteration --------------------------------------------------------------------------

    def _begin(self, motion: Motion) -> None:
        nodes, friction = self.nodes, self._friction
        if friction is not None and self._began is not None:
            went = nodes.displacement(motion.start) - nodes.displacement(self._began)
            friction = replace(friction, beside=went - self._obstacle_went)
        self._points.begin(nodes.positions(motion.start) - self._ends[0], friction)

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add the resistance of pressed nodes."""
        if self._points.pressed is None:
            self._begin(motion)
        pressed = self._points.press(self.nodes.moved(motion) - self._moved)
        if pressed.at.size:
            force = np.zeros_like(self._points.y0)
            force[pressed.at] = pressed.force
            self.nodes.add(force, forces)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add the derivative of the resistance at the last iterate."""
        pressed = self._points.pressed
        assert pressed is not None  # residuals come before tangents
        self.nodes.stiffen(pressed.stiffness, tangent, pressed.at)
        self._in_tangent = self._slopes()

    def _slopes(self) -> Array:
        return self._points.slopes()

    # After a step -------------------------------------------------------------------------------

    def _gap(self, at: Instant) -> Array:
        return self._asked.gap(self.nodes.positions(at) - self._displacement(at.t))

    def taken(self, motion: Motion) -> float:
        """Energy that friction takes [J]."""
        pressed = self._points.pressed
        return 0.0 if pressed is None else pressed.dissipated

    def pressing(self) -> tuple[Ints, Array]:
        """Pressed nodes: along the normal, with friction along two tangents too."""
        points = self._points
        ways, p = np.zeros((len(self.nodes), 3, 3)), points.pressed
        if p is not None and p.at.size:
            y = points.y0[p.at] + p.moved
            gap = np.minimum(points.g0[p.at], self._asked.gap(y))
            deep = p.at[gap < -CLOSED * np.abs(y).max(axis=1)]
            ways[deep, 0] = n = self._asked.outward(points.y0[deep])
            if self._friction is not None:
                ways[deep, 1] = np.cross(n, IDENTITY[np.abs(n).round(6).argmin(axis=1)])
                ways[deep, 2] = np.cross(n, ways[deep, 1])
        return self.nodes.acted(ways)

    def touch(self) -> Touch:
        """Force at the step's midpoint, in statics at its end, and the work of the obstacle."""
        points = self._points
        p = points.pressed
        if p is None or not p.at.size:
            return Touch(self.title)
        share = 1.0 if self._static else 0.5
        at = self._ends[1] if self._static else self._ends.mean(axis=0)
        y0 = points.y0[p.at]
        place, gap = y0 + share * p.moved + at, self._asked.gap(y0 + p.moved)
        out = self._touched(self._k[p.at], gap, -p.force, place)
        return replace(out, work=float(out.force @ self._moved), dissipated=p.dissipated)

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """Time until the first gap closes; -1 if a node touches [s]."""
        c0, c1 = self._displacement(at.t), self._displacement(at.t + dt)
        y = self.nodes.positions(at) - c0
        w = self.nodes.velocities(v, at.bodies) - (c1 - c0) / dt
        g = self._asked.gap(y)
        if (g < 0).any():
            return -1.0
        return soonest(g, np.einsum("ni,ni->n", self._asked.outward(y), w))

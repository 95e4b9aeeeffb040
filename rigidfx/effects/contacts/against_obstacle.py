"""A contact with an obstacle on the nodes and bodies of a division."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import ContactAction, Structure, Touch
from rigidfx.effects.base import vector_at
from rigidfx.effects.contacts.asked import AskedObstacle
from rigidfx.effects.contacts.obstacles import Obstacle
from rigidfx.effects.contacts.penalty import stored
from rigidfx.effects.contacts.pressing import CLOSED, IDENTITY, Points, Pressed
from rigidfx.effects.contacts.surface import ContactSurface
from rigidfx.effects.motion import Instant, Motion, Tangent
from rigidfx.effects.nodes import Nodes

__all__ = ["ObstacleForces"]


class ObstacleForces(ContactAction):
    """The forces of an obstacle."""

    def __init__(
        self,
        effect: Any,
        obstacle: Obstacle,
        surface: ContactSurface,
        structure: Structure,
    ) -> None:
        """Find the nodes of the surface. Collective.

        Args:
            effect: The contact.
            obstacle: Its partner.
            surface: Nodal stiffnesses.
            structure: Its nodes and bodies.
        """
        self.kind, self.title = effect.kind, effect.title
        self._effect, self._obstacle, self._static = effect, obstacle, structure.static
        self._asked = AskedObstacle(effect.owner, obstacle, structure.failures)
        k = surface.stiffness[: structure.scene.owned_nodes]
        self.nodes = nodes = Nodes(structure, np.flatnonzero(k > 0))
        self._points = Points(self._asked, k[nodes.nodes], self._static)
        self._begun = False  # whether the points know where the step begins
        self._ends: Array = np.zeros((2, 3))  # displacements of the obstacle
        self._dt, self._friction = 0.0, effect.friction_in(0.0)
        self._began: Instant | None = None  # where a longer motion began ...
        self._obstacle_went: Array = np.zeros(3)  # ... and how far the obstacle has gone [m]
        square = structure.scene.comm.allreduce(float(k @ k), op=MPI.SUM)
        self.rounding = float(np.sqrt(square)) * nodes.far()

    def set_time(self, t: float, dt: float) -> None:
        """Place the obstacle at both ends of a step; in statics t is the end of the step.

        Raises:
            SceneError: On this rank, if the path fails.
        """
        before, after = (dt, 0.0) if self._static else (dt / 2, dt / 2)
        began = max(t - before, 0.0)
        self._ends = np.stack([self._displacement(began), self._displacement(t + after)])
        self._dt, self._begun, self._began = dt, False, None
        self._friction = self._effect.friction_in(dt)

    def creep_for(self, time: float, began: Instant) -> None:
        """See `ContactAction`: the obstacle has gone as in the step all the time."""
        friction = self._effect.friction_in(time)
        if friction is not None:
            # Of the step itself half counts, as in forces halfway.
            self._friction = replace(friction, part=0.5)
            self._obstacle_went = (time / self._dt - 0.5) * self._moved
            self._begun, self._began = False, began

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
        nodes, friction, self._begun = self.nodes, self._friction, True
        if friction is not None and self._began is not None:
            went = nodes.displacement(motion.start) - nodes.displacement(self._began)
            friction = replace(friction, beside=went - self._obstacle_went)
        self._points.begin(nodes.positions(motion.start) - self._ends[0], friction)

    def resist(self, motion: Motion, forces: Any) -> None:
        """See `Action`."""
        if not self._begun:
            self._begin(motion)
        pressed = self._points.press(self.nodes.moved(motion) - self._moved)
        if pressed.at.size:
            force = np.zeros_like(self._points.y0)
            force[pressed.at] = pressed.force
            self.nodes.add(force, forces)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """See `Action`."""
        pressed = self._points.pressed
        assert pressed is not None  # residuals come before tangents
        self.nodes.stiffen(pressed.stiffness, tangent, pressed.at)
        self._points.assembled()

    def outdated(self) -> bool:
        """See `ContactAction`."""
        return self._points.outdated

    # After a step -------------------------------------------------------------------------------

    @property
    def _pressed(self) -> Pressed | None:
        """The points that are pressed in the step; None before its first iterate."""
        return self._points.pressed if self._begun else None

    def stored(self, at: Instant) -> float:
        """See `Action`."""
        y = self.nodes.positions(at) - self._displacement(at.t)
        return float(stored(self._points.k, self._asked.gap(y)).sum())

    def taken(self, motion: Motion) -> float:
        """See `Action`."""
        return 0.0 if self._pressed is None else self._pressed.dissipated

    def pressing(self) -> tuple[Ints, Array]:
        """See `ContactAction`: along the normal, with friction along two tangents, too."""
        ways, p, points = np.zeros((len(self.nodes), 3, 3)), self._pressed, self._points
        if p is not None and p.at.size:
            y = points.y0[p.at] + p.moved
            gap = np.minimum(points.g0[p.at], self._asked.gap(y))
            deep = p.at[gap < -CLOSED * np.abs(y).max(axis=1)]
            ways[deep, 0] = n = self._asked.outward(points.y0[deep])
            if self._friction is not None:
                ways[deep, 1] = np.cross(n, IDENTITY[np.abs(n).round(6).argmin(axis=1)])
                ways[deep, 2] = np.cross(n, ways[deep, 1])
        return self.nodes.on_bodies(ways)

    def touch(self) -> Touch:
        """See `ContactAction`."""
        p, points = self._pressed, self._points
        if p is None or not p.at.size:
            return Touch(self.title)
        share = 1.0 if self._static else 0.5
        at = self._ends[1] if self._static else self._ends.mean(axis=0)
        middle = points.y0[p.at] + share * p.moved + at
        g = self._asked.gap(points.y0[p.at] + p.moved)
        force = -p.force.sum(axis=0)
        return Touch(
            self.title,
            force=force,
            moment=-np.cross(middle, p.force).sum(axis=0),
            pressing=float(np.linalg.norm(p.force, axis=1).sum()),
            energy=float(stored(points.k[p.at], g).sum()),
            work=float(force @ self._moved),
            dissipated=p.dissipated,
            penetration=float(np.maximum(-g, 0.0).max()),
            nodes=int(np.count_nonzero(g < 0)),
        )

    def closes_after(self, v: Array, dt: float, at: Instant) -> float:
        """See `ContactAction`."""
        c0, c1 = self._displacement(at.t), self._displacement(at.t + dt)
        y = self.nodes.positions(at) - c0
        w = self.nodes.velocities(v, at.bodies) - (c1 - c0) / dt
        g = self._asked.gap(y)
        if (g < 0).any():
            return -1.0
        rate = np.einsum("ni,ni->n", self._asked.outward(y), w)
        comes = rate < 0
        with np.errstate(over="ignore"):  # in longer than there are numbers
            return float((g[comes] / -rate[comes]).min(initial=np.inf))

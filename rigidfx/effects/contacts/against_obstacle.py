"""A contact with an obstacle on the nodes and bodies of a division.

The contact nodes of a body are loaded nodes of it: they move by a = [1, V] times the body's matrix
of increments, so their forces enter its six unknowns by Σ f and Σ V fᵀ.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.effects.action import Action, Structure, Touch
from rigidfx.effects.base import vector_at
from rigidfx.effects.contacts.asked import AskedObstacle
from rigidfx.effects.contacts.obstacles import Obstacle
from rigidfx.effects.contacts.penalty import stored
from rigidfx.effects.contacts.pressing import Points
from rigidfx.effects.contacts.surface import ContactSurface
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments, Step

__all__ = ["ObstacleForces"]

Array = npt.NDArray[np.float64]


class ObstacleForces(Action):
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
        self._effect, self._obstacle = effect, obstacle
        self._asked = AskedObstacle(effect.owner, obstacle, structure.failures)
        scene, rows = structure.scene, structure.rows
        self._comm: MPI.Intracomm = scene.comm
        k = surface.stiffness[: scene.owned_nodes]
        self._at = np.flatnonzero(structure.own & (k[rows.nodes] > 0))
        self._nodes = rows.nodes[self._at]
        self._static = structure.static
        self._X = rows.X[self._at]
        self._points = Points(self._asked, k[self._nodes], self._static)
        self._dofs, self._u0 = rows.dofs.reshape(-1, 3)[self._at], structure.u
        records = structure.bodies.of.records
        touching = [np.flatnonzero(k[body.nodes] > 0) for body in records]
        self._of = np.repeat(np.arange(len(records)), [own.size for own in touching])
        pairs = list(zip(records, touching, strict=True))
        every = [np.c_[np.ones(own.size), body.offsets[own]] for body, own in pairs]
        self._a = np.concatenate([np.empty((0, 4)), *every])
        of_bodies = [k[body.nodes[own]] for body, own in pairs]
        self._loaded = Points(self._asked, np.concatenate([np.empty(0), *of_bodies]), self._static)
        self._of_step: Step | None = None
        self._ends: Array = np.zeros((2, 3))  # displacements of the obstacle
        self._dt, self._friction = 0.0, effect.friction_in(0.0)
        self._began: Bodies | None = None  # where bodies were as a longer motion began ...
        self._obstacle_went: Array = np.zeros(3)  # ... and how far the obstacle has gone [m]
        self.rounding = self._rounding(k, structure)

    def _rounding(self, k: Array, structure: Structure) -> float:
        """Size of the terms whose small difference forces are [N]. Collective."""
        n = k.size
        X = structure.scene.space.tabulate_dof_coordinates()[:n]
        far = np.abs(X + structure.u[: 3 * n].reshape(-1, 3))[k > 0].max(initial=0.0)
        far = self._comm.allreduce(float(far), op=MPI.MAX)
        return float(np.sqrt(self._comm.allreduce(float(k @ k)))) * far

    def set_time(self, t: float, dt: float) -> None:
        """Place the obstacle at both ends of a step, and see where its nodes begin.

        In statics t is the end of the step.

        Raises:
            SceneError: On this rank, if the path fails.
        """
        before, after = (dt, 0.0) if self._static else (dt / 2, dt / 2)
        began = max(t - before, 0.0)
        self._ends = np.stack([self._displacement(began), self._displacement(t + after)])
        self._dt, self._of_step, self._began = dt, None, None
        self._friction = self._effect.friction_in(dt)
        y0 = self._X + self._u0[self._dofs] - self._ends[0]
        self._points.begin(y0, self._friction)

    def creep_for(self, time: float, u: Array, bodies: Bodies) -> None:
        """See `Action`: the obstacle has gone as in the step all the time."""
        friction = self._effect.friction_in(time)
        if friction is None:
            return
        self._of_step = None
        # Of the step itself half counts, as in forces halfway.
        self._friction = replace(friction, part=0.5)
        self._obstacle_went = (time / self._dt - 0.5) * self._moved
        self._began = bodies
        beside = self._u0[self._dofs] - u[self._dofs] - self._obstacle_went
        self._points.begin(self._points.y0, replace(self._friction, beside=beside))

    def _displacement(self, t: float) -> Array:
        obstacle = self._obstacle
        return vector_at(
            self._effect.owner, f"path of the {obstacle.kind}", t, lambda: obstacle.displacement(t)
        )

    @property
    def _moved(self) -> Array:
        return np.asarray(self._ends[1] - self._ends[0])

    # In each iteration --------------------------------------------------------------------------

    def resist_nodes(self, d: Any, dt: float, f: Any) -> None:
        """See `Action`."""
        pressed = self._points.press(d.array_r.reshape(-1, 3)[self._at] - self._moved)
        if pressed.at.size:
            f.array.reshape(-1, 3)[self._at[pressed.at]] += pressed.force

    def stiffen_nodes(self, tangent: Any, dt: float, prolongation: Any) -> None:
        """See `Action`."""
        pressed = self._points.pressed
        assert pressed is not None  # residuals come before tangents
        tangent.add_nodal(self._nodes[pressed.at], pressed.stiffness)
        self._points.assembled()

    def resist_bodies(self, increments: Increments) -> Array:
        """See `Action`. Collective."""
        if self._of_step is not increments.step:
            self._of_step = increments.step
            x0 = self._follow(increments.start.pose)
            friction = self._friction
            if friction is not None and self._began is not None:
                beside = x0 - self._follow(self._began.pose) - self._obstacle_went
                friction = replace(friction, beside=beside)
            self._loaded.begin(x0 - self._ends[0], friction)
        p = self._loaded.press(self._follow(increments.displacement) - self._moved)
        out = np.zeros((len(increments), 4, 3))
        np.add.at(out, self._of[p.at], self._a[p.at, :, None] * p.force[:, None])
        return self._summed(out)

    def _follow(self, matrices: Array) -> Array:
        """Vectors of bodies' nodes from matrices of the bodies, shape (bodies, 4, 3)."""
        return np.asarray((self._a[:, None] @ matrices[self._of])[:, 0])

    def stiffen_bodies(self, increments: Increments) -> Array:
        """See `Action`. Collective."""
        p = self._loaded.pressed
        assert p is not None  # residuals come before tangents
        self._loaded.assembled()
        a = self._a[p.at]
        blocks = a[:, :, None, None, None] * a[:, None, None, :, None]
        out = np.zeros((len(increments), 4, 3, 4, 3))
        np.add.at(out, self._of[p.at], blocks * p.stiffness[:, None, :, None])
        sums = self._summed(out).reshape(-1, 12, 12)
        return np.asarray(increments.L.swapaxes(1, 2) @ sums @ increments.P)

    def outdated(self) -> bool:
        """See `Action`."""
        return self._points.outdated or self._loaded.outdated

    def _summed(self, values: Array) -> Array:
        """Sum over ranks, in place. Collective."""
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, values)
        return values

    # After a step -------------------------------------------------------------------------------

    def stored(self, u: Array, bodies: Bodies, t: float) -> float:
        """See `Action`."""
        c = self._displacement(t)
        nodes = self._X + u.reshape(-1, 3)[self._at] - c
        loaded = self._follow(bodies.pose) - c
        pairs = (self._points.k, nodes), (self._loaded.k, loaded)
        return sum(float(stored(k, self._asked.gap(y)).sum()) for k, y in pairs)

    def dissipated(self, d: Any, dt: float, increments: Increments) -> float:
        """See `Action`."""
        both = self._points.pressed, self._loaded.pressed
        return sum(pressed.dissipated for pressed in both if pressed is not None)

    def touch(self) -> Touch:
        """See `Action`."""
        out = Touch(self.title)
        for points in (self._points, self._loaded):
            p = points.pressed
            if p is None or not p.at.size:
                continue
            share = 1.0 if self._static else 0.5
            at = self._ends[1] if self._static else self._ends.mean(axis=0)
            middle = points.y0[p.at] + share * p.moved + at
            g = self._asked.gap(points.y0[p.at] + p.moved)
            force = -p.force.sum(axis=0)
            out = out + Touch(
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
        return out

    def closes_after(self, v: Array, t: float, dt: float, bodies: Bodies) -> float:
        """See `Action`."""
        c0, c1 = self._displacement(t), self._displacement(t + dt)
        x = self._follow(bodies.pose)
        arms, omega = x - bodies.r[self._of], bodies.angular_velocity[self._of]
        loaded = bodies.velocity[self._of] + np.cross(omega, arms)
        y = np.concatenate([self._X + self._u0[self._dofs], x]) - c0
        w = np.concatenate([v.reshape(-1, 3)[self._at], loaded]) - (c1 - c0) / dt
        g = self._asked.gap(y)
        if (g < 0).any():
            return -1.0
        rate = np.einsum("ni,ni->n", self._asked.outward(y), w)
        comes = rate < 0
        with np.errstate(over="ignore"):  # in longer than there are numbers
            return float((g[comes] / -rate[comes]).min(initial=np.inf))

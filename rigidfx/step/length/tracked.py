"""Points whose motion is tracked while steps are tried: displacements, and velocities at both ends.

A body's nodes have its motion, whether they take part in a step or not; what moves with a support
does what that does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.bodies import Bodies, times
from rigidfx.scene.points import far_apart, find_probes
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.system.system import System

__all__ = ["Tracked"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NODES = 32  # of its own choice, where no probes are named
NONE = -1


class Tracked:
    """Some probes, or nodes far from each other.

    Attributes:
        count: Number of points.
    """

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        """Find the points. Collective.

        Args:
            scene: The problem.
            names: Names of probes; nodes are chosen if there are none.
        """
        self._scene = scene
        if names:
            probes = find_probes(scene)
            points = [probes[name] for name in names]
            self._nodes = np.concatenate([point.nodes for point in points]).astype(np.int64)
            weights = np.concatenate([point.weights for point in points])
            of = np.repeat(np.arange(len(points)), [point.nodes.size for point in points])
            self.count = len(points)
        else:
            self._nodes, of = far_apart(scene, NODES)
            weights = np.ones(self._nodes.size)
            self.count = NODES
        self._sums = np.zeros((self.count, self._nodes.size))
        self._sums[of, np.arange(self._nodes.size)] = weights
        self._X = scene.space.tabulate_dof_coordinates()[self._nodes]
        self._dofs = 3 * self._nodes[:, None] + np.arange(3)
        self._body: Ints = np.full(self._nodes.size, NONE)
        self._arms: Array = np.zeros((self._nodes.size, 3))
        self._rows: Ints = np.full(self._nodes.size, NONE)
        self._bodies: tuple[object, ...] = ()

    def bind(self, system: System, bodies: Bodies) -> bool:
        """Find the points in a division.

        Args:
            system: The equations of the division.
            bodies: Its bodies.

        Returns:
            Whether there are other bodies than before.
        """
        before = self._bodies
        self._body[:] = self._rows[:] = NONE
        self._bodies = bodies.of.records
        for k, body in enumerate(bodies.of.records):
            place = np.searchsorted(body.nodes, self._nodes)
            inside = place < body.nodes.size
            inside[inside] = body.nodes[place[inside]] == self._nodes[inside]
            self._body[inside] = k
            self._arms[inside] = body.offsets[place[inside]]
        rows = system.layout.rows.nodes
        place = np.searchsorted(rows, self._nodes)
        known = (place < rows.size) & (self._body == NONE)
        known[known] = rows[place[known]] == self._nodes[known]
        self._rows[known] = place[known]
        return [*map(id, before)] != [*map(id, self._bodies)]

    def motion(self, system: System, state: State, dt: float) -> tuple[Array, Array, Array]:
        """Velocities at both ends of the step that has been solved, displacements at its end.

        Collective.

        Args:
            system: The equations that have been solved.
            state: The state at the start.
            dt: Δt [s].

        Returns:
            Shape (points, 3) each [m/s, m/s, m].
        """
        free, inside = self._rows != NONE, self._body != NONE
        d = np.zeros(self._X.shape)
        d[free] = system.equilibrium.d.array_r.reshape(-1, 3)[self._rows[free]]
        start = state.v.x.array[self._dofs]
        v0 = np.where(inside[:, None], 0.0, start)
        v1 = np.where(free[:, None], 2 / dt * d - start, v0)
        moved = state.u.x.array[self._dofs] + d
        if inside.any():
            increments, k = system.equilibrium.prolongation.increments, self._body[inside]
            for v, bodies in ((v0, increments.start), (v1, increments.end)):
                arms = times(bodies.R[k], self._arms[inside])
                v[inside] = bodies.velocity[k] + np.cross(bodies.angular_velocity[k], arms)
            end = increments.end.r[k] + times(increments.end.R[k], self._arms[inside])
            of_bodies = np.zeros(self._X.shape)
            of_bodies[inside] = end - self._X[inside]
            moved = np.where(inside[:, None], of_bodies, moved)
        total = np.asarray(self._scene.sum(self._sums @ np.hstack([v0, v1, moved])))
        return total[:, :3], total[:, 3:6], total[:, 6:]

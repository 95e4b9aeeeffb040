"""Points whose motion is tracked while steps are tried: displacements, and velocities at both ends.

A body's nodes have its motion, whether they take part in a step or not. A node of a support is at
its prescribed place at the end of each step, without an error. After a kink of the path the
velocity of such a node, 2 Δu/Δt - v, alternates from step to step, which would count as an error at
each change of Δt. So such nodes have the mean velocity of a step at both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.scene.points import far_apart, find_probes, parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.system.system import System

NODES = 32  # of its own choice
ROUNDING = 1e-9  # of a probe's weights of nodes, which add up to one


class Tracked:
    """Some probes, and nodes far from each other of the connected parts that these belong to.

    Attributes:
        asked: Number of the points that are asked for, the first of all: the probes, or all nodes
            if there are none.
        count: Number of all points.
        nodes: Owned nodes, of whose motion that of points is a weighted sum.
    """

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        """Find the points. Collective."""
        self._scene, probes = scene, find_probes(scene) if names else {}
        points = [probes[name] for name in names]
        own = np.concatenate([np.empty(0, np.int64), *(p.nodes for p in points)])
        nodes, places = far_apart(scene, NODES, _parts_of(scene, own) if names else None)
        self.count, self.asked = len(points) + NODES, len(points) or NODES
        self.nodes: Ints = np.concatenate([own, nodes]).astype(np.int64)
        of = np.repeat(np.arange(len(points)), [p.nodes.size for p in points])
        self._sums = np.zeros((self.count, self.nodes.size))
        self._sums[np.concatenate([of, len(points) + places]), np.arange(self.nodes.size)] = (
            np.concatenate([*(p.weights for p in points), np.ones(nodes.size)])
        )
        self._X = scene.space.tabulate_dof_coordinates()[self.nodes]
        self._dofs = 3 * self.nodes[:, None] + np.arange(3)
        self._body: Ints = np.full(self.nodes.size, -1)
        self._a: Array = np.zeros((self.nodes.size, 4))  # their coordinates in bodies
        self._free: Ints = np.empty(0, np.int64)  # those that take part in a step ...
        self._rows: Ints = np.empty((0, 3), np.int64)  # ... and where in its increments
        self._held: Bools = np.zeros(self._X.shape, dtype=bool)
        self._bodies: tuple[object, ...] = ()

    def bind(self, system: System, bodies: Bodies) -> bool:
        """Find the points in a division.

        Args:
            system: The equations of the division.
            bodies: Its bodies.

        Returns:
            Whether there are other bodies than before.
        """
        before, self._bodies = self._bodies, bodies.of.records
        self._body[:] = -1
        self._a = np.zeros((self.nodes.size, bodies.pose.shape[1]))
        for k, body in enumerate(bodies.of.records):
            inside, place = _found(body.nodes, self.nodes)
            a = body.coordinates(place)
            self._body[inside] = k
            self._a[inside, : a.shape[1]] = a
        known, place = _found(system.layout.rows.nodes, self.nodes)
        taking = self._body[known] < 0
        self._free = known[taking]
        self._rows = 3 * place[taking, None] + np.arange(3)
        self._held = system.layout.prescribed[self._dofs]
        return [*map(id, before)] != [*map(id, self._bodies)]

    @property
    def led(self) -> bool:
        """Whether supports hold or move all points that are asked for. Collective."""
        weights = np.abs(self._sums[: self.asked])
        return float(self._scene.sum((weights @ ~self._held).sum())) < ROUNDING

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
        free, inside = self._free, self._body >= 0
        local: Array = np.empty((self.nodes.size, 9))
        v0, v1, moved = local[:, :3], local[:, 3:6], local[:, 6:]
        v0[:] = v1[:] = state.v.x.array[self._dofs]
        moved[:] = state.u.x.array[self._dofs]
        d = system.equilibrium.d.array_r[self._rows]
        v1[free] = 2 / dt * d - v0[free]
        moved[free] += d
        v0[self._held] = v1[self._held] = (v0[self._held] + v1[self._held]) / 2
        if inside.any():
            increments, k = system.equilibrium.prolongation.increments, self._body[inside]
            a, end = self._a[inside, None], increments.end
            for v, bodies in ((v0, increments.start), (v1, end)):
                v[inside] = (a @ bodies.pose_rate[k])[:, 0]
            moved[inside] = (a @ end.pose[k])[:, 0] - self._X[inside]
        total = np.asarray(self._scene.sum(self._sums @ local))
        return total[:, :3], total[:, 3:6], total[:, 6:]


def _found(among: npt.NDArray[np.integer[Any]], nodes: Ints) -> tuple[Ints, Ints]:
    """Which of some nodes are among sorted ones, and their places there."""
    place = np.searchsorted(among, nodes)
    inside = np.flatnonzero(np.isin(nodes, among))
    return inside, place[inside]


def _parts_of(scene: Scene, nodes: Ints) -> Bools:
    """Owned nodes of the connected parts that some nodes of all ranks are in. Collective."""
    of_node = parts_of_nodes(scene)
    held = np.asarray(scene.sum(np.bincount(of_node[nodes], minlength=scene.parts.count) + 0.0))
    return np.asarray(held[of_node[: scene.owned_nodes]] > 0)

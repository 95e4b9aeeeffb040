"""What a freeze leaves the cells beside a body to strain.

At a freeze the nodes of a body take the rigid motion that has their momenta. Cells beside it, which
have some of these nodes, strain by that from then on: where the body does not move as they do, by a
kink. By what they strain there forces on the body change, and by no more: an internal vibration of
a part, however loud, is no motion that others have to take over.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from rigidfx.decide.clusters import CellGraph
from rigidfx.decide.criteria.concentration import stiffness
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.decision import PlannedBody
from rigidfx.flexible.indicator import Indicator
from rigidfx.mechanics.rotation import axial, skew
from rigidfx.scene.scene import Scene

__all__ = ["Kinks"]

Array = npt.NDArray[np.float64]


class Kinks:
    """Measures them as all strains are measured."""

    def __init__(self, scene: Scene, graph: CellGraph, indicator: Indicator) -> None:
        """Take the cells over. Collective.

        Args:
            scene: The problem.
            graph: Neighbours of its cells.
            indicator: A measure of its own.
        """
        self._scene, self._graph, self._indicator = scene, graph, indicator
        self._stiffness = stiffness(scene)
        self._ends = fem.Function(scene.space), fem.Function(scene.space)

    def loud(self, seen: Observation, new: Sequence[PlannedBody], tol: Array) -> Array:
        """How fast forces on bodies would strain them, over their tolerances. Collective.

        Args:
            seen: The state before their freeze.
            new: The bodies that are to be.
            tol: Strain rate up to which each owned cell is quiet [1/s].

        Returns:
            Of each body the stress rate of the loudest cell beside it, by the stiffness of this,
            over what its own cells have at their tolerances, shape (bodies,).
        """
        scene, graph, state, n = self._scene, self._graph, seen.state, self._scene.owned_nodes
        state.rebuild()
        u, v = (f.x.array[: 3 * n].reshape(-1, 3).copy() for f in (state.u, state.v))
        for now in state.bodies:  # with a consistent mass nodes beside flexible cells have another
            v[now.data.nodes] = now.velocities
        motions = self._rigid_motions(new, state.X[:n] + u, v)
        rigid, numbers = ~seen.flexible, np.full(graph.owned, -np.inf)
        for k, (body, velocities) in enumerate(zip(new, motions, strict=True)):
            v[body.nodes] = velocities
            numbers[body.cells], rigid[body.cells] = k, True
        half = 0.5 * seen.dt * v  # about the present shape: what turns as a whole strains nothing
        for end, values in zip(self._ends, (u - half, u + half), strict=True):
            end.x.array[: values.size] = values.reshape(-1)
            end.x.scatter_forward()
        of = graph.largest_round_cells(numbers).max(axis=1)
        beside = np.flatnonzero(np.isfinite(of) & ~rigid).astype(np.int32)
        self._indicator.bind(seen.stepper.forces.cells(beside), self._ends)
        stress, quiet = np.zeros(len(new)), np.full(len(new), np.inf)
        rates = self._indicator.measure(seen.dt)
        np.maximum.at(stress, of[beside].astype(np.int64), self._stiffness[beside] * rates)
        for k, body in enumerate(new):
            quiet[k] = (self._stiffness[body.cells] * tol[body.cells]).min(initial=np.inf)
        scene.comm.Allreduce(MPI.IN_PLACE, stress, op=MPI.MAX)
        scene.comm.Allreduce(MPI.IN_PLACE, quiet, op=MPI.MIN)
        return np.divide(stress, quiet, out=np.full(len(new), np.inf), where=quiet > 0)

    def _rigid_motions(self, new: Sequence[PlannedBody], x: Array, v: Array) -> list[Array]:
        """Velocities of bodies' nodes in the rigid motions that have their momenta. Collective.

        Args:
            new: The bodies.
            x: Places of owned nodes, shape (nodes, 3) [m].
            v: Their velocities, likewise [m/s].
        """
        local, masses = np.zeros((len(new), 8, 3)), self._scene.averaging_mass
        for sums, body in zip(local, new, strict=True):
            m, at = masses[body.nodes, None], x[body.nodes]
            p = m * v[body.nodes]
            sums[0], sums[1], sums[2] = m.sum(), (m * at).sum(axis=0), p.sum(axis=0)
            sums[3:6], sums[6] = at.T @ (m * at), axial(at.T @ p)
        out = []
        for sums, body in zip(np.asarray(self._scene.sum(local)), new, strict=True):
            mass, centre, velocity = sums[0, 0], sums[1] / sums[0], sums[2] / sums[0]
            spread = sums[3:6] - mass * np.outer(centre, centre)
            inertia = np.trace(spread) * np.eye(3) - spread
            spin = sums[6] - np.cross(centre, sums[2])
            omega = np.linalg.pinv(inertia) @ spin  # none about a line of nodes
            out.append(velocity + (x[body.nodes] - centre) @ skew(omega).T)
        return out

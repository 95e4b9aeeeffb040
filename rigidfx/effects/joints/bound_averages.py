"""Averages bound to the nodes and bodies of a division: where they are, and forces on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.matrices import compact
from rigidfx.effects.joints.averages import Average
from rigidfx.effects.joints.stiff import StiffRow, weights_of
from rigidfx.effects.motion import Forces, ForcesOfNodes
from rigidfx.mechanics.bodies import Bodies

__all__ = ["BoundAverages"]

Array = npt.NDArray[np.float64]


class BoundAverages:
    """Averages of nodes, which are free or in bodies; arrays are equal on all ranks.

    Attributes:
        own: Weights of nodes that are no body's, shape (averages, places among these nodes).
        held: Weights of the bodies' a = [1, V, Φ₁, ..., Φ_m], shape (averages, n · bodies).
        at: Places of the nodes of `own` among the rows of the division.
    """

    def __init__(
        self,
        averages: Sequence[Average],
        stiff: Mapping[int, StiffRow],
        scene: Any,
        rows: Any,
        own: npt.NDArray[np.bool_],
        bodies: Bodies,
        u: Array,
    ) -> None:
        """Find whose nodes they are. Collective.

        Args:
            averages: The averages.
            stiff: Rows of those that follow a body as a rigid face does, by their number.
            scene: The problem.
            rows: Rows of the nodes that take part.
            own: For each of these nodes, whether it belongs to no body.
            bodies: The bodies.
            u: Displacements of all local dofs at the start of a step [m], changed by each step.
        """
        self._comm: MPI.Intracomm = scene.comm
        self._once = float(scene.comm.rank == 0)
        self._every, self._u0 = tuple(averages), u
        self._constant = np.reshape([average.constant for average in averages], (-1, 3))
        W, self.held = weights_of(scene, bodies.of.records, averages, stiff)
        self.at = np.flatnonzero(own & (np.diff(W.tocsc().indptr)[rows.nodes] > 0))
        self.own = W[:, rows.nodes[self.at]].tocsr()
        self._spread, self._moments = self.own.T.tocsr(), compact(self.held.T.tocsr())
        self._poses = compact(self.held.tocsr())
        self._X, self._dofs = rows.X[self.at], rows.dofs.reshape(-1, 3)[self.at]

    def mean(self, of_nodes: Array, of_bodies: Array | None = None) -> Array:
        """Averages of vectors at nodes and of matrices of bodies, shape (averages, 3). Collective.

        Args:
            of_nodes: Of the nodes of `own`, shape (nodes, 3).
            of_bodies: Shape (bodies, n, 3); zero if None.
        """
        out = np.asarray(self.own @ of_nodes)
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out if of_bodies is None else out + self._poses @ of_bodies.reshape(-1, 3)

    def places(self, bodies: Bodies) -> Array:
        """Where averages are now, shape (averages, 3). Collective.

        Args:
            bodies: The bodies now.
        """
        return self.mean(self._X + self._u0[self._dofs], bodies.pose) + self._constant

    def add(self, on_averages: Array, forces: Forces) -> None:
        """Add forces on averages, shape (averages, 3) [N], to those on nodes and bodies."""
        forces.nodes[self.at] += self._spread @ on_averages
        if forces.moments.size and self._once:  # all ranks know them
            forces.moments[...] += (self._moments @ on_averages).reshape(forces.moments.shape)

    def add_at_nodes(self, on_averages: Array, forces: ForcesOfNodes) -> None:
        """Add forces on averages, shape (averages, 3) [N], to those on nodes, in bodies or not."""
        for average, force in zip(self._every, on_averages, strict=True):
            forces.nodes[average.nodes] += average.weights[:, None] * force

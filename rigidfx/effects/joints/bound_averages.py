"""Averages bound to a division, seen as `rigidfx.effects.nodes` shows nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_array

from rigidfx.base.matrices import compact, dense
from rigidfx.base.types import Array
from rigidfx.effects.action import Structure
from rigidfx.effects.joints.averages import Average
from rigidfx.effects.motion import Forces, ForcesOfNodes, Instant
from rigidfx.effects.nodes import Nodes
from rigidfx.mechanics.rigid_body import RigidBody

__all__ = ["BoundAverages", "StiffRow", "stiff_rows"]


@dataclass(frozen=True)
class StiffRow:
    """How a vector follows a body.

    Attributes:
        row: Its coefficients of [1, V] of the body, shape (4,).
        body: Number of the body.
        products: Σ w (X - X̄) ⊗ V of the face, shape (3, 3) [m²].
    """

    row: Array
    body: int
    products: Array


def stiff_rows(
    scene: Any, bodies: Sequence[RigidBody], vectors: Sequence[Any]
) -> dict[int, StiffRow]:
    """How vectors of faces that a body holds, and of carried masses, follow it. Collective.

    Args:
        scene: The problem.
        bodies: The bodies.
        vectors: Averages and vectors of faces.

    Returns:
        By the number of the vector.
    """
    out: dict[int, StiffRow] = {}
    known: dict[int, tuple[int, Array, Array] | None] = {}
    for k, vector in enumerate(vectors):
        if (holder := vector.holder) is None:
            continue
        if id(holder) not in known:
            known[id(holder)] = holder.within(scene, bodies)
        if (found := known[id(holder)]) is not None:
            out[k] = StiffRow(vector.in_body(*found[1:]), found[0], found[2])
    return out


class BoundAverages(Nodes):
    """Averages of nodes, which are free or in bodies; arrays are equal on all ranks.

    Attributes:
        own: Weights of nodes that are no body's, shape (averages, these nodes).
        held: Weights of the bodies' a = [1, V, Φ₁, ..., Φ_m], shape (averages, n · bodies).
    """

    def __init__(
        self, averages: Sequence[Average], stiff: Mapping[int, StiffRow], structure: Structure
    ) -> None:
        """Find whose nodes they are. Collective.

        Args:
            averages: The averages.
            stiff: Rows of those that follow a body as a rigid face does, by their number.
            structure: The division.
        """
        scene, own = structure.scene, [average.nodes for average in averages]
        number = np.repeat(np.arange(len(own)), [some.size for some in own])
        values = np.concatenate([np.empty(0), *(average.weights for average in averages)])
        at = number, np.concatenate([np.empty(0, np.int64), *own])
        W = csr_array((values, at), shape=(len(own), scene.owned_nodes))
        super().__init__(structure, np.flatnonzero(np.diff(W.tocsc().indptr)))
        self._once, self._W = bool(structure.once), W[:, self.nodes].tocsr()
        count = self.rows.size
        self.own = self._W[:, :count].tocsr()
        every = np.asarray(scene.sum(dense(self._W[:, count:] @ self._A)))
        for k, row in stiff.items():
            every[k].reshape(len(structure.bodies), -1)[row.body, :4] = row.row
        self.held = csr_array(every)
        self._spread, self._moments = self.own.T.tocsr(), compact(self.held.T.tocsr())
        self._poses = compact(self.held.tocsr())
        constant = [average.constant for average in averages]
        self._constant = np.reshape(constant, (-1, 3))

    def mean(self, of_rows: Array, matrices: Array | None = None) -> Array:
        """Averages of vectors at nodes and of matrices of bodies, shape (averages, 3). Collective.

        Args:
            of_rows: Of the nodes that are no body's, shape (nodes, 3).
            matrices: Shape (bodies, n, 3); zero if None.
        """
        out = np.asarray(self.own @ of_rows)
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out if matrices is None else out + self._poses @ matrices.reshape(-1, 3)

    def _all(self, of_rows: Array, matrices: Array) -> Array:
        return self.mean(of_rows, matrices)

    def positions(self, at: Instant) -> Array:
        """See `Nodes`; with the constants. Collective."""
        return super().positions(at) + self._constant

    def add(self, force: Array, forces: Forces | ForcesOfNodes) -> None:
        """Add forces on averages, shape (averages, 3) [N], which all ranks know.

        Args:
            force: The forces.
            forces: `Forces`, or `ForcesOfNodes` of all nodes, in bodies or not.
        """
        if isinstance(forces, ForcesOfNodes):
            forces.add(self, self._W.T @ force)
            return
        forces.nodes[self.rows] += self._spread @ force
        if forces.moments.size and self._once:
            forces.moments[...] += (self._moments @ force).reshape(forces.moments.shape)

"""Aggregates of nodes that lie together, and the rigid motions of each as columns of a matrix.

Smoothing leaves errors that hardly strain over some cells. A coarse problem has to represent them,
here by motions in which each aggregate moves like a rigid body (R. A. Nicolaides,
doi:10.1137/0724027, takes constants). Aggregates are the leaves of a k-d tree of this rank's nodes,
boxes with about equal numbers of nodes; each rigid body is an aggregate.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.spatial import cKDTree

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.step.newton.motions import EMPTY

__all__ = ["Aggregates"]

Int = PETSc.IntType

# Nodes of an aggregate, at most. An L of 196 875 unknowns (solves to a hundredth, 8.0 iterations
# without a coarse grid) took 3.7, 4.1, 4.4 and 4.6 with 130, 200, 260 and 520.
NODES = 260


class Aggregates:
    """The aggregates of a layout."""

    def __init__(self, prolongation: Prolongation) -> None:
        """Divide the nodes. Collective.

        Args:
            prolongation: Map between unknowns and dofs.
        """
        self._prolongation = prolongation
        self._free = prolongation.free_of_nodes
        leaf = _leaves(prolongation.at_nodes(prolongation.layout.rows.X), NODES)
        self._order = np.argsort(leaf, kind="stable")
        self._leaf = leaf
        self._starts = np.flatnonzero(np.diff(leaf[self._order], prepend=-1))

    def motions(self, x: Array) -> PETSc.Mat:
        """Their rigid motions, orthonormal, as a new matrix that the caller destroys. Collective.

        Args:
            x: Positions of the active nodes, shape (nodes, 3) [m].

        Returns:
            A row for each unknown; six columns for each aggregate, fewer where supports leave none
            of some of its motions.
        """
        B, kept = self._orthonormal(self._prolongation.at_nodes(x))
        numbers = np.cumsum(kept).reshape(kept.shape) - 1
        of_node = kept[self._leaf]
        taken = self._free[:, :, None] & of_node[:, None, :]
        columns = np.broadcast_to(numbers[self._leaf][:, None, :], B.shape)[taken]
        lengths = np.broadcast_to(of_node.sum(axis=1)[:, None], self._free.shape)[self._free]
        count = int(kept.sum())
        own = self._prolongation.owned - self._prolongation.own_free
        lengths = np.r_[lengths, np.ones(own, dtype=np.int64)]
        columns = np.r_[columns, count + np.arange(own)]
        values = np.r_[B[taken], np.ones(own)]
        comm = self._prolongation.comm
        columns += comm.exscan(count + own) or 0
        out = PETSc.Mat().createAIJ(
            [(self._prolongation.owned, None), (count + own, None)],
            csr=(np.r_[0, np.cumsum(lengths)].astype(Int), columns.astype(Int), values),
            comm=comm,
        )
        out.assemble()
        return out

    def _orthonormal(self, x: Array) -> tuple[Array, Bools]:
        """Motions of each node with its aggregate, and which an aggregate has.

        Returns:
            Shapes (nodes, 3, 6) and (aggregates, 6).
        """
        leaf, count = self._leaf, np.diff(np.r_[self._starts, len(self._leaf)])
        middle = self._summed(x) / count[:, None]
        arms = x - middle[leaf]
        length = np.sqrt(self._summed((arms**2).sum(axis=1)) / count)
        B = rigid_motions(arms, np.where(length > 0, length, 1.0)[leaf, None])
        B *= self._free[:, :, None]
        squares, vectors = np.linalg.eigh(self._summed(B.swapaxes(1, 2) @ B))
        kept = squares > EMPTY * squares[:, -1:]
        vectors /= np.sqrt(np.where(kept, squares, np.inf))[:, None, :]
        return B @ vectors[leaf], kept

    def _summed(self, values: Array) -> Array:
        """Sums over the nodes of each aggregate."""
        if not self._starts.size:
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(np.add.reduceat(values[self._order], self._starts))


def _leaves(X: Array, size: int) -> Ints:
    """The number of the leaf of each point; a leaf has at most `size` of them."""
    leaf = np.zeros(len(X), dtype=np.int64)
    if not len(X):
        return leaf
    tree = cKDTree(X, leafsize=size)
    nodes, count = [tree.tree], 0
    while nodes:
        node = nodes.pop()
        if node.lesser is None:
            leaf[tree.indices[node.start_idx : node.end_idx]] = count
            count += 1
        else:
            nodes += [node.lesser, node.greater]
    return leaf

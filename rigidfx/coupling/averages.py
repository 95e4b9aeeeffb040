"""Matrices at vectors of nodes: Σ Jᵀ B J, J the derivatives of a vector, B three by three."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import block_diag, csr_array, hstack

from rigidfx.base.types import Array, Bools
from rigidfx.coupling.rows import Rows
from rigidfx.effects.joints.averages import Vector
from rigidfx.scene.scene import Scene

__all__ = ["add_at_vectors", "slopes_of"]


def slopes_of(scene: Scene, vector: Vector, rows: Rows, counted: Bools) -> csr_array | None:
    """Derivatives of a vector by nodes at the start; None if some do not count. Collective.

    Args:
        scene: The problem.
        vector: The vector.
        rows: The rows in question.
        counted: For each node of the rows, whether it counts.

    Returns:
        Shape (3, 3 · nodes of the rows).
    """
    nodes, slopes = vector.nodes, vector.slopes()
    at = np.searchsorted(rows.nodes, nodes)
    at[at == rows.nodes.size] = 0
    here = rows.nodes[at] == nodes if rows.nodes.size else np.zeros(at.size, dtype=bool)
    here &= counted[at] if rows.nodes.size else False
    if scene.sum(np.count_nonzero(~here)) > 0:
        return None
    columns = np.broadcast_to(3 * at[:, None, None] + np.arange(3), slopes.shape)
    row = np.broadcast_to(np.arange(3)[:, None], slopes.shape)
    return csr_array((slopes.ravel(), (row.ravel(), columns.ravel())), (3, 3 * rows.nodes.size))


def add_at_vectors(A: PETSc.Mat, slopes: csr_array, blocks: Array, comm: MPI.Intracomm) -> None:
    """Add Σ Jᵀ B J to a matrix, whose pattern grows. Collective.

    Args:
        A: The matrix of some rows.
        slopes: J of each vector, shape (3 · vectors, 3 · nodes of the rows).
        blocks: B of each, shape (vectors, 3, 3).
        comm: The ranks.
    """
    every = hstack(comm.allgather(slopes), format="csr")
    B, kind = block_diag([csr_array(block) for block in blocks]), PETSc.IntType
    added = csr_array(slopes.T @ B @ every)
    csr = added.indptr.astype(kind), added.indices.astype(kind), added.data
    more = PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=comm)
    A.axpy(1.0, more, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    more.destroy()

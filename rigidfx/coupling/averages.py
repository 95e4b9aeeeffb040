"""Matrices at averages of nodes: Σ c cᵀ ⊗ B, c the weights of an average, B three by three."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import block_diag, csr_array, eye_array, hstack, kron

from rigidfx.coupling.rows import Rows
from rigidfx.effects.joints.averages import Average
from rigidfx.scene.scene import Scene

__all__ = ["add_at_averages", "weights_of"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


def weights_of(scene: Scene, average: Average, rows: Rows, counted: Bools) -> csr_array | None:
    """Weights of the nodes of an average; None if some of its nodes do not count. Collective.

    Args:
        scene: The problem.
        average: The average.
        rows: The rows in question.
        counted: For each node of the rows, whether it counts.

    Returns:
        Shape (1, nodes of the rows).
    """
    at = np.searchsorted(rows.nodes, average.nodes)
    at[at == rows.nodes.size] = 0
    here = rows.nodes[at] == average.nodes if rows.nodes.size else np.zeros(at.size, dtype=bool)
    here &= counted[at] if rows.nodes.size else False
    if scene.sum(np.count_nonzero(~here)) > 0:
        return None
    return csr_array((average.weights, (np.zeros(at.size, int), at)), (1, rows.nodes.size))


def add_at_averages(A: PETSc.Mat, weights: csr_array, blocks: Array, comm: MPI.Intracomm) -> None:
    """Add Σ c cᵀ ⊗ B to a matrix, whose pattern grows. Collective.

    Args:
        A: The matrix of some rows.
        weights: c of each average, shape (averages, nodes of the rows).
        blocks: B of each, shape (averages, 3, 3).
        comm: The ranks.
    """
    own = csr_array(kron(weights, eye_array(3), format="csr"))
    every = hstack(comm.allgather(own), format="csr")
    B, kind = block_diag([csr_array(block) for block in blocks]), PETSc.IntType
    added = csr_array(own.T @ B @ every)
    csr = added.indptr.astype(kind), added.indices.astype(kind), added.data
    more = PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=comm)
    A.axpy(1.0, more, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    more.destroy()

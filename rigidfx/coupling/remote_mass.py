"""Matrices at vectors of nodes, Σ Jᵀ B J, and masses at points of faces: B = m.

J are the derivatives of a vector by nodes, B is three by three.

They take part where all of these nodes do. A reduced tangent gets nothing of them here: with steps
they are a stiffness at ports, see `rigidfx.effects.attached.point_mass`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import block_diag, csr_array, hstack, vstack

from rigidfx.base.types import Array, Bools
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import PointMass
from rigidfx.effects.joints.averages import Vector
from rigidfx.scene.scene import Scene


class WithRemoteMasses:
    """A mass operator with masses at points of faces."""

    def __init__(self, within: Any, rows: Rows, masses: Array, slopes: csr_array) -> None:
        """Keep them.

        Args:
            within: The mass operator of cells and nodes.
            rows: The rows it acts on.
            masses: The masses [kg].
            slopes: J of each, shape (3 · masses, 3 · nodes of the rows).
        """
        self._within, self._rows = within, rows
        self._masses, self._slopes = masses, slopes

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v. Collective."""
        self._within.mult(v, out)
        moved = np.asarray(self._slopes @ v.array_r)
        self._rows.comm.Allreduce(MPI.IN_PLACE, moved)
        out.array[:] += self._slopes.T @ (np.repeat(self._masses, 3) * moved)

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M but for these masses. Collective."""
        self._within.add_to(tangent, factor, prolongation)

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it. Collective."""
        M = self._within.matrix()
        blocks = self._masses[:, None, None] * np.eye(3)
        add_at_vectors(M, self._slopes, blocks, self._rows.comm)
        return M

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._within.destroy()


def with_remote_masses(
    scene: Scene, mass: Any, rows: Rows, counted: Bools, carried: bool = False
) -> Any:
    """A mass operator with the masses at points of faces all of whose nodes count. Collective.

    Args:
        scene: The problem.
        mass: The operator of cells and nodes.
        rows: The rows it acts on.
        counted: For each node of the rows, whether it counts.
        carried: Whether masses count that are bodies of their own in a run.
    """
    masses: list[float] = []
    slopes: list[csr_array] = []
    for effect in (e for e in scene.named(PointMass) if e.face is not None):
        if effect.is_carried and not carried:
            continue
        own = slopes_of(scene, effect.remote.place, rows, counted)
        if own is not None:
            masses.append(float(effect.mass))
            slopes.append(own)
    if not masses:
        return mass
    return WithRemoteMasses(mass, rows, np.array(masses), csr_array(vstack(slopes, format="csr")))


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

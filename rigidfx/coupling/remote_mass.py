"""Masses at points of faces: m c cᵀ, c the weights of the nodes that move the point.

They take part where all of these nodes do. A reduced tangent gets nothing of them here: with steps
they are a stiffness at ports, see `rigidfx.effects.attached.point_mass`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, eye_array, hstack, kron, vstack

from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import PointMass
from rigidfx.scene.scene import Scene

__all__ = ["with_remote_masses"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


class _WithRemote:
    """A mass operator with masses at points of faces."""

    def __init__(self, within: Any, rows: Rows, masses: Array, weights: csr_array) -> None:
        """Take them.

        Args:
            within: The mass operator of cells and nodes.
            rows: The rows it acts on.
            masses: The masses [kg].
            weights: c of each, shape (masses, nodes of the rows).
        """
        self._within, self._rows = within, rows
        self._masses, self._weights = masses[:, None], weights

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v. Collective."""
        self._within.mult(v, out)
        means = np.asarray(self._weights @ v.array_r.reshape(-1, 3))
        self._rows.comm.Allreduce(MPI.IN_PLACE, means)
        out.array[:] += (self._weights.T @ (self._masses * means)).ravel()

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M but for these masses. Collective."""
        self._within.add_to(tangent, factor, prolongation)

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it. Collective."""
        M, comm = self._within.matrix(), self._rows.comm
        own = csr_array(kron(self._weights, eye_array(3), format="csr"))
        parts = comm.allgather(own)
        every = hstack(parts, format="csr")
        block = csr_array((own.T * np.repeat(self._masses[:, 0], 3)) @ every)
        kind = PETSc.IntType
        csr = block.indptr.astype(kind), block.indices.astype(kind), block.data
        more = PETSc.Mat().createAIJ(M.getSizes(), csr=csr, comm=comm)
        M.axpy(1.0, more, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        more.destroy()
        return M

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._within.destroy()


def with_remote_masses(scene: Scene, mass: Any, rows: Rows, counted: Bools) -> Any:
    """A mass operator with the masses at points of faces all of whose nodes count. Collective.

    Args:
        scene: The problem.
        mass: The operator of cells and nodes.
        rows: The rows it acts on.
        counted: For each node of the rows, whether it counts.
    """
    masses: list[float] = []
    weights: list[csr_array] = []
    for effect in (e for e in scene.named(PointMass) if e.face is not None):
        place = effect.remote.place
        at = np.searchsorted(rows.nodes, place.nodes)
        at[at == rows.nodes.size] = 0
        here = rows.nodes[at] == place.nodes if rows.nodes.size else np.zeros(at.size, dtype=bool)
        here &= counted[at] if rows.nodes.size else False
        if scene.sum(np.count_nonzero(~here)) > 0:
            continue
        masses.append(float(effect.mass))
        entries = place.weights, (np.zeros(at.size, dtype=int), at)
        weights.append(csr_array(entries, shape=(1, rows.nodes.size)))
    if not masses:
        return mass
    return _WithRemote(mass, rows, np.array(masses), csr_array(vstack(weights, format="csr")))

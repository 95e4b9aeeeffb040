"""The stiffness of a structure, factored once for many right sides."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx.base.errors import SceneError
from rigidfx.error.forces.rigid_motions import independent
from rigidfx.shapes.iterative import conjugate_gradients
from rigidfx.shapes.stiffness import Stiffness, times
from rigidfx.step.linear.definite import solver_of

__all__ = ["Solver"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SOLVED = 1e-6  # part of forces that a solve may leave: more is left where K is not definite
# Unknowns: factors of a block of so many take some 3 GB.
FACTORED_UP_TO = 150_000
UNSTABLE = (
    "Reduced: the structure is not stable in its present state, its stiffness is not definite: it "
    "buckles, or a part hangs by a line or a point of others. Reduce it in a state before the "
    "limit load, or leave the part flexible."
)


class Solver:
    """K⁻¹ with some rows pinned that determine the motions without stiffness."""

    def __init__(self, stiffness: Stiffness, loose: Array) -> None:
        """Factor. Collective.

        Args:
            stiffness: The stiffness.
            loose: Its motions without stiffness, shape (owned nodes, 3, n).

        Raises:
            SceneError: On every rank, if it is not definite.
        """
        self._of, p = stiffness, stiffness.prolongation
        self._pins = self._pinned(stiffness.unknowns_of(loose))
        K = stiffness.matrix().convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        diagonal = K.getDiagonal()
        scale = float(diagonal.norm()) / np.sqrt(p.size)
        diagonal.destroy()
        K.zeroRowsColumns((p.first_column + self._pins).astype(PETSc.IntType), diag=scale)
        if p.size > FACTORED_UP_TO:
            self._ksp = conjugate_gradients(K, p, stiffness.places[stiffness.structure.rows.nodes])
            return
        self._ksp = solver_of(K)
        if not _definite(self._ksp):
            self._ksp.destroy()
            raise SceneError(UNSTABLE)

    def _pinned(self, motions: Array) -> Ints:
        """Unknowns of this rank that determine motions together with those of other ranks.

        Collective.

        Args:
            motions: Of the unknowns of this rank, shape (owned, n).
        """
        comm = self._of.prolongation.comm
        own = independent(motions)
        every = comm.allgather(motions[own])
        chosen = independent(np.concatenate(every))
        first = sum(len(rows) for rows in every[: comm.rank])
        mine = chosen[(chosen >= first) & (chosen < first + own.size)] - first
        return np.sort(own[mine])

    def solve(self, F: Array) -> Array:
        """Displacements by forces on nodes, in balance. Collective.

        Args:
            F: Shape (owned nodes, 3, k) [N].

        Returns:
            Of the same shape [m].
        """
        right = self._of.on_unknowns(F)
        right[self._pins] = 0.0
        found = self._solved(right)
        K, _ = self._ksp.getOperators()
        left = right - times(K, found, self._of.prolongation.unknowns)
        sizes = self._of.scene.sum(np.stack([(left**2).sum(axis=0), (right**2).sum(axis=0)]))
        if not (sizes[0] <= SOLVED**2 * sizes[1]).all():
            raise SceneError(UNSTABLE)
        return self._of.at_nodes(found)

    def _solved(self, right: Array) -> Array:
        """K⁻¹ times several right sides of this rank's unknowns. Collective."""
        p = self._of.prolongation
        sizes = (p.owned, None), (None, right.shape[1])
        B, X = (PETSc.Mat().createDense(sizes, comm=p.comm) for _ in range(2))
        for dense in (B, X):
            dense.setUp()
        B.getDenseArray()[:] = right
        for dense in (B, X):
            dense.assemble()
        self._ksp.matSolve(B, X)
        out = X.getDenseArray().copy()
        B.destroy()
        X.destroy()
        return np.asarray(out)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()


def _definite(ksp: PETSc.KSP) -> bool:
    """Whether a factored matrix is positive definite; CHOLMOD has factored no other. Collective."""
    pc = ksp.getPC()
    if pc.getFailedReason():
        return False
    if pc.getFactorSolverType() != PETSc.Mat.SolverType.MUMPS:
        return True
    return int(pc.getFactorMatrix().getMumpsInfog(12)) == 0  # negative pivots

"""The tangent at the end of a step, which kept ones come near to only.

Numbers that are reported must not depend on when a solver renews its own tangent: that is another
matter on other numbers of ranks, and in resumed runs.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.equations.joined import JoinedEquilibrium
from rigidfx.step.linear.linear_solver import configure
from rigidfx.step.newton.border import Border

__all__ = ["PresentTangent"]


class PresentTangent:
    """Responses to forces at the end of a step; `destroy` frees the solver."""

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations.
        """
        self._equilibrium, p = equilibrium, equilibrium.prolongation
        self._border: Border | None = None
        if isinstance(equilibrium, JoinedEquilibrium):
            self._border = Border(equilibrium)
        self._ksp = PETSc.KSP().create(p.comm)
        configure(self._ksp, True, p.size, len(p.layout.bodies) > 0)
        self._A: PETSc.Mat | None = None

    def renew(self) -> None:
        """Take the tangent at the last iterate; other solvers keep theirs. Collective."""
        matrix = self._equilibrium.tangent_matrix
        others = matrix.copy() if matrix.assembled else None
        entries = _entries(matrix)
        self._equilibrium.tangent()
        grown = _entries(matrix) != entries
        if self._A is None or grown:
            self._free()
            self._A = matrix.copy()
        else:
            matrix.copy(self._A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._ksp.setOperators(self._A)
        if self._border is not None:
            self._border.renew(self._ksp.solve, self._ksp)
        if others is not None:
            if not grown:
                others.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            others.destroy()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Response to forces. Collective.

        Args:
            r: Right-hand side.
            z: Solution, overwritten.
        """
        if self._border is None:
            self._ksp.solve(r, z)
        else:
            self._border.solve(self._ksp.solve, r, z, kept=True)

    def _free(self) -> None:
        if self._A is not None:
            self._A.destroy()

    def destroy(self) -> None:
        """Free the solver. Collective."""
        self._ksp.destroy()
        self._free()
        if self._border is not None:
            self._border.destroy()


def _entries(matrix: PETSc.Mat) -> float:
    """Number of entries of a matrix on all ranks. Collective."""
    return float(matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"])

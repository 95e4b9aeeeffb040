"""Solve with the factors of a tangent, for as long as it stays the one that was factored.

Small systems have LU by PETSc itself where inertia makes pivots needless; others Cholesky's factors
of the symmetric part on one rank, until a tangent has been found to be too far from that; all
others LU by MUMPS.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear import cholmod
from rigidfx.step.linear.linear_solver import QUICK_UP_TO, configure
from rigidfx.step.newton.cholesky import Cholesky
from rigidfx.step.newton.price import price

__all__ = ["Factors"]


class Factors:
    """LU of a tangent, or Cholesky's factors; `destroy` frees them.

    Attributes:
        renewal: Cost of a new tangent, its factors included, in iterations with these; 0 before
            there are some.
        iterations: How many the last solve counts as.
    """

    iterations = 1

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        self.renewal = 0.0
        self._equilibrium, comm = equilibrium, equilibrium.prolongation.comm
        self._quick = False
        self._ksp = PETSc.KSP().create(comm)
        one = comm.size == 1 and cholmod.exists()
        self._cholesky = Cholesky(equilibrium.tangent_matrix) if one else None
        self._take_pivots(True)

    def _take_pivots(self, pivots: bool) -> None:
        self._pivots, p = pivots, self._equilibrium.prolongation
        self._quick = not pivots and p.size <= QUICK_UP_TO
        configure(self._ksp, True, p.size, len(p.layout.bodies) > 0, self._quick)
        self._ksp.setOperators(self._equilibrium.tangent_matrix)

    @property
    def _present(self) -> PETSc.KSP:
        """The solver."""
        return self._ksp if self._quick or self._cholesky is None else self._cholesky.ksp

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._present.getType()}+{self._present.getPC().getType()}"

    def renew(self) -> None:
        """Factor a new tangent, and choose the solver. Collective."""
        if self._pivots == self._equilibrium.well_conditioned:
            self._take_pivots(not self._pivots)
        self.renewal = price(self._equilibrium.tangent_matrix, self._made())

    def _made(self) -> PETSc.Mat:
        """Make the factors. Collective."""
        if not self._quick and self._cholesky is not None:
            if self._cholesky.renew():
                return self._cholesky.ksp.getPC().getFactorMatrix()
            self._cholesky.destroy()
            self._cholesky = None
        self._ksp.setUp()
        return self._ksp.getPC().getFactorMatrix()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r, or nearly so. Collective."""
        self._present.solve(r, z)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()
        if self._cholesky is not None:
            self._cholesky.destroy()

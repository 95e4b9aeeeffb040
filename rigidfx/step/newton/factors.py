"""Solve with the factors of a tangent, for as long as it stays the one that was factored.

Small systems, and those whose factors have few entries, have LU by PETSc itself if inertia makes
pivots needless. Others have Cholesky's factors of the symmetric part, on one rank, until the skew
part of a tangent is too large. All others have LU by MUMPS.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear import cholmod
from rigidfx.step.linear.linear_solver import QUICK_UP_TO, configure
from rigidfx.step.newton.band import few_entries
from rigidfx.step.newton.cholesky import Cholesky
from rigidfx.step.newton.price import price

__all__ = ["Factors"]

# Unknowns up to which factors of few entries are PETSc's own; those of second-order hexahedra took
# .2 s longer to make than MUMPS's at 7776, and 4 s at 24 000.
FEW_UP_TO = 5_000


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
        A = self._equilibrium.tangent_matrix
        # A solve with few entries is the faster by PETSc itself: steps of bars and plates of 670 to
        # 4400 unknowns took .69 to .85 of those with MUMPS's factors, new ones included.
        few = p.size <= FEW_UP_TO and few_entries(A)
        self._quick = not pivots and (p.size <= QUICK_UP_TO or few)
        configure(self._ksp, True, p.size, len(p.layout.bodies) > 0, self._quick)
        self._ksp.setOperators(A)

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

    def take_all(self) -> None:
        """Factor all of a tangent from now on, not its symmetric part."""
        if self._cholesky is not None:
            self._cholesky.destroy()
            self._cholesky = None

    def _made(self) -> PETSc.Mat:
        """Make the factors. Collective."""
        if not self._quick and self._cholesky is not None:
            if self._cholesky.renew():
                return self._cholesky.ksp.getPC().getFactorMatrix()
            self.take_all()
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

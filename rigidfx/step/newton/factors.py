"""Solve with the factors of a tangent, for as long as it stays the one that was factored."""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import QUICK_UP_TO, configure
from rigidfx.step.newton.band import few_entries

__all__ = ["Factors"]

# Unknowns up to which factors of few entries are PETSc's own; those of second-order hexahedra took
# .2 s longer to make than MUMPS's at 7776, and 4 s at 24 000.
FEW_UP_TO = 5_000


class Factors:
    """LU of a tangent; `destroy` frees it.

    Attributes:
        renewal: What a new tangent costs, its factors included, in iterations with these.
        worth: What a step by Newton's method and GMRES costs in such iterations.
        iterations: How many the last solve counts as.
    """

    iterations = 1

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        p = equilibrium.prolongation
        self.renewal = renewal_by_factors(p.size)
        # Of soft parts: 11 to 17 at 190 to 490 unknowns, 18 to 47 at 670 to 3100.
        self.worth = 12.0 if p.size <= QUICK_UP_TO else 18.0
        self._equilibrium = equilibrium
        self._ksp = PETSc.KSP().create(p.comm)
        self._take_pivots(True)

    def _take_pivots(self, pivots: bool) -> None:
        self._pivots, p = pivots, self._equilibrium.prolongation
        A = self._equilibrium.tangent_matrix
        # A solve with few entries is the faster by PETSc itself: steps of bars and plates of 670 to
        # 4400 unknowns took .69 to .85 of those with MUMPS's factors, new ones included.
        few = p.size <= FEW_UP_TO and few_entries(A)
        quick = not pivots and (p.size <= QUICK_UP_TO or few)
        configure(self._ksp, True, p.size, len(p.layout.bodies) > 0, quick)
        self._ksp.setOperators(A)

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._ksp.getType()}+{self._ksp.getPC().getType()}"

    def renew(self) -> None:
        """Take note of a new tangent, which PETSc sees by itself; choose whether it has pivots."""
        if self._pivots == self._equilibrium.well_conditioned:
            self._take_pivots(not self._pivots)

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r. Collective."""
        self._ksp.solve(r, z)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()


def renewal_by_factors(unknowns: int) -> float:
    """What a new tangent costs, in iterations with a kept one, of one rank.

    Between what was measured of slender and of compact parts: bars took 7 at 10³ unknowns and 9 at
    5·10³, blocks 13 at 2·10³ and 28 at 1.5·10⁴, an L 6, 12, 16 and 23 at 670, 4·10³, 1.2·10⁴ and
    2.7·10⁴. Where a tangent is renewed depends on it weakly.
    """
    return 0.6 * unknowns**0.36

"""Solve with the factors of a tangent, for as long as it stays the one that was factored."""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import QUICK_UP_TO, configure
from rigidfx.step.newton.band import few_entries

__all__ = ["Factors", "costs"]

# Unknowns up to which factors of few entries are PETSc's own; those of second-order hexahedra took
# .2 s longer to make than MUMPS's at 7776, and 4 s at 24 000.
FEW_UP_TO = 5_000

# Costs, in what an iteration takes for each entry of the tangent beside its solve, 1.8 ns: to
# assemble one, to make and to solve with one of the factors, by MUMPS and by PETSc itself (whose
# floating-point operations are those of a band), and all calls of an iteration. Of 20 systems of
# 160 to 19 000 unknowns, bars, plates and blocks, soft and of steel, second order and enhanced, a
# frame and the block with a cantilever, the sum was .8 to 1.6 times what was measured, 2 to 47.
ASSEMBLED, CALLS = 13.0, 65e3
MADE, FLOP, ENTRY = 8.0, 0.007, 0.55
OWN_FLOP, OWN_ENTRY = 0.13, 0.13
# Likewise of an iteration of Newton's method by GMRES with incomplete factors, in soft systems of
# 160 to 4300 unknowns, a new tangent included; and how many a step takes that is not easy.
KRYLOV, KRYLOV_CALLS = 19.0, 1e5
NEWTON = 4
UNKNOWN = 10.0, 15.0  # iterations, before there are factors


class Factors:
    """LU of a tangent; `destroy` frees it.

    Attributes:
        renewal: What a new tangent costs, its factors included, in iterations with these; by what
            these hold, once there are some.
        worth: What a step by Newton's method and GMRES costs in such iterations, likewise.
        iterations: How many the last solve counts as.
    """

    iterations = 1

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        self.renewal, self.worth = UNKNOWN
        self._equilibrium = equilibrium
        self._ksp = PETSc.KSP().create(equilibrium.prolongation.comm)
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
        """Factor a new tangent, with pivots or without. Collective."""
        if self._pivots == self._equilibrium.well_conditioned:
            self._take_pivots(not self._pivots)
        self._ksp.setUp()
        pc = self._ksp.getPC()
        own = pc.getFactorSolverType() == PETSc.Mat.SolverType.PETSC
        A = self._equilibrium.tangent_matrix
        self.renewal, self.worth = costs(A, pc.getFactorMatrix(), own)

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r. Collective."""
        self._ksp.solve(r, z)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()


def costs(A: PETSc.Mat, factors: PETSc.Mat, own: bool) -> tuple[float, float]:
    """What a new tangent, and a step by GMRES, cost in iterations with a kept one. Collective.

    Args:
        A: The tangent.
        factors: Its factors.
        own: Whether they are PETSc's own, which has one rank.
    """
    entries = _entries(A)
    if own:
        held = _entries(factors)
        making, solving = OWN_FLOP * held**2 / (2 * A.size[0]), OWN_ENTRY * held
    else:
        held = float(factors.getMumpsInfog(29))
        held = held if held >= 0 else -1e6 * held  # in millions where they are many
        making, solving = MADE * held + FLOP * factors.getMumpsRinfog(3), ENTRY * held
    iteration = entries + CALLS + solving
    by_krylov = NEWTON * (KRYLOV * entries + KRYLOV_CALLS)
    return (ASSEMBLED * entries + making) / iteration, by_krylov / iteration


def _entries(A: PETSc.Mat) -> float:
    """Entries of a matrix on all ranks. Collective."""
    return float(A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"])

"""Solve with a tangent by GMRES and incomplete factors, both of a tangent that is kept.

Where inertia is large, GMRES takes a handful of iterations to a hundredth, and each costs a third
of a solve with full factors, or less. Newton's iteration with a kept tangent removes the error of a
solve, as it does the tangent's own error.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import PREFIX, configure, default_options

OWN = PREFIX + "incomplete_"  # prefix of its options
REDUCTION = 1e-2  # of the residual in a solve
MAX_ITERATIONS = 100


class IncompleteFactors:
    """GMRES with incomplete factors of each rank's rows; `destroy` frees it.

    Options of PETSc's are understood under the prefix `rigidfx_incomplete_`.

    Attributes:
        renewal: Cost of a new tangent, its factors included, in iterations with these.
    """

    # 3 at 700 unknowns, 7 at 4000, 4 at 27 000; 8 to 12 with a coarse grid, beyond 100 000
    renewal = 5.0

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        p = equilibrium.prolongation
        self._ksp = PETSc.KSP().create(p.comm)
        self._ksp.setOptionsPrefix(OWN)
        self._defaults = _of_ranks(len(p.layout.bodies) > 0) if p.comm.size > 1 else {}
        with default_options(OWN, **self._defaults):
            configure(self._ksp, False, p.size, len(p.layout.bodies) > 0)
            # This kind keeps what the factors have made of each direction, and spares a solve with
            # them at the end: one in five.
            self._ksp.setType(PETSc.KSP.Type.FGMRES)
            self._ksp.setTolerances(rtol=REDUCTION, atol=0.0, max_it=MAX_ITERATIONS)
            self._ksp.setFromOptions()
        self._ksp.setOperators(equilibrium.tangent_matrix)

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._ksp.getType()}+{self._ksp.getPC().getType()}"

    @property
    def iterations(self) -> int:
        """How many the last solve took."""
        return int(self._ksp.getIterationNumber())

    def renew(self) -> None:
        """Follow a new tangent. Collective."""
        with default_options(OWN, **self._defaults):  # blocks are told when they are made
            self._ksp.setUp()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r, to a hundredth. Collective."""
        self._ksp.solve(r, z)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()


def _of_ranks(bodies: bool) -> dict[str, str]:
    """Options on several ranks.

    With the rows round its own, in the order that one rank would take, a rank's factors are as good
    as those of all: at 27 000 unknowns on two ranks a step took 37 iterations, 37 on one rank, 52
    by blocks without others' rows.
    """
    return {
        "pc_type": "asm",
        "pc_asm_overlap": "1",
        "sub_pc_factor_mat_ordering_type": "natural" if bodies else "rcm",
    }

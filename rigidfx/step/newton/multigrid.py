"""Solve with a tangent by multigrid, where its factors would fill the memory.

Smoothed aggregation (PETSc's GAMG; Vaněk, Mandel and Brezina, doi:10.1007/BF02238511) is told the
six rigid motions of the structure as it stands: what hardly strains is what smoothing leaves, and a
coarse grid has to represent it. Then GMRES takes about as many iterations in large systems as in
small ones. Each solve ends at a thousandth of what it began with: the error that the kept tangent
leaves is no smaller, and Newton's iteration removes both.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import PREFIX, default_options
from rigidfx.step.newton.krylov import Krylov
from rigidfx.step.newton.motions import rigid_motions

__all__ = ["Multigrid"]

OWN = PREFIX + "multigrid_"  # prefix of its options
REDUCTION = 1e-3  # of the residual in a solve
MAX_ITERATIONS = 100  # a tenth suffices where the coarse grids serve at all
DEFAULTS = {
    # They belong to a direction in space, as the tangent does.
    "pc_gamg_reuse_interpolation": "false",
    # Smoothing by the blocks of nodes, and aggregates of what is strongly coupled: 51 iterations in
    # a step of a steel bar of 97 000 unknowns, 66 without.
    "mg_levels_pc_type": "pbjacobi",
    "pc_gamg_threshold": "0.02",
}


class Multigrid(Krylov):
    """GMRES preconditioned by smoothed aggregation; `destroy` frees it.

    Options of PETSc's are understood under the prefix `rigidfx_multigrid_`.

    Attributes:
        renewal: What a new tangent costs, its coarse grids included, in iterations with these.
        worth: What a step by Newton's method costs in such iterations.
    """

    renewal = 4.0  # of bars of steel of 97 000 and 353 000 unknowns
    worth = float("inf")  # where GMRES with incomplete factors gives up

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        self._equilibrium = equilibrium
        self._rows: PETSc.Mat = None  # the tangent in the only format that aggregation takes
        self._ksp = PETSc.KSP().create(equilibrium.prolongation.comm)
        self._ksp.setOptionsPrefix(OWN)
        self._ksp.setType(PETSc.KSP.Type.GMRES)
        self._ksp.setPCSide(PETSc.PC.Side.RIGHT)  # the residual is that of the system itself
        self._ksp.setTolerances(rtol=REDUCTION, atol=0.0, max_it=MAX_ITERATIONS)
        self._ksp.getPC().setType(PETSc.PC.Type.GAMG)
        with default_options(OWN, **DEFAULTS):
            self._ksp.setFromOptions()

    def renew(self) -> None:
        """Take note of a new tangent, at the last iterate of the equations. Collective."""
        A = self._equilibrium.tangent_matrix
        if A.getType().endswith("baij"):
            # Freed first: a copy in place keeps what the coarse grids were made from.
            self._free()
            self._rows = PETSc.Mat()
            A.convert(PETSc.Mat.Type.AIJ, out=self._rows)
            A = self._rows
        modes = rigid_motions(self._equilibrium.prolongation, self._equilibrium.positions)
        vectors = []
        for mode in modes.T:
            vectors.append(self._equilibrium.prolongation.unknowns())
            vectors[-1].array[:] = mode
        motions = PETSc.NullSpace().create(vectors=vectors, comm=A.comm)
        A.setNearNullSpace(motions)
        motions.destroy()
        for vector in vectors:
            vector.destroy()
        self._ksp.setOperators(A)
        with default_options(OWN, **DEFAULTS):  # smoothers are told when grids are made
            self._ksp.setUp()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r, to a thousandth. Collective."""
        self._ksp.solve(r, z)

    def _free(self) -> None:
        if self._rows is not None:
            self._rows.destroy()

    def destroy(self) -> None:
        """Free the grids. Collective."""
        self._ksp.destroy()
        self._free()

"""Direct factors of symmetric, definite matrices, for many solves.

By CHOLMOD on one rank; by MUMPS on several, and where a material gives way, so that the matrix is
not definite.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.linear import cholmod
from rigidfx.step.linear.linear_solver import default_options

__all__ = ["PREFIX", "solver_of"]

PREFIX = "rigidfx_error_"  # of the options of all of them
# Unknowns up to which METIS takes more time than its order saves: at 4536 to 7203 factors by AMD's
# are there in .55 to .74 of the time, solves take 1.0 to 1.2; 1.9 in a plate of 14 406.
BRIEF = 10_000


def solver_of(A: PETSc.Mat, brief: bool = False) -> PETSc.KSP:
    """A solver with kept factors of a symmetric, definite matrix, which it owns. Collective.

    Args:
        A: The matrix.
        brief: Whether the factors serve for few solves, or have few entries.
    """
    A.setOption(PETSc.Mat.Option.SPD, True)
    if A.comm.size == 1 and cholmod.exists():
        ksp = cholmod.solver(A.comm, PREFIX)
        if cholmod.factor(ksp, A, brief=brief or A.size[0] <= BRIEF):
            A.destroy()  # its solver holds it
            return ksp
        ksp.destroy()
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(A)
    given = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
    with default_options(PREFIX, **given):
        ksp.setFromOptions()
    ksp.setUp()
    A.destroy()
    return ksp

"""Direct factors of symmetric, definite matrices, for many solves.

By CHOLMOD on one rank; by MUMPS on several, and where a material gives way, so that the matrix is
not definite. A solve with CHOLMOD's factors takes 0.76 of the time of one with MUMPS's at 24 321
unknowns of a bar, 0.6 at 6321 and a quarter at 1575, and they are made as fast.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.linear.linear_solver import default_options

PREFIX = "rigidfx_error_"  # of the options of all of them
# Unknowns up to which METIS takes more time than its order saves: at 4536 to 7203 factors by AMD's
# are there in .55 to .74 of the time, solves take 1.0 to 1.2; 1.9 in a plate of 14 406.
BRIEF = 10_000

DEFAULTS = {
    "mat_cholmod_print": "0",  # that a matrix is not definite is an answer here
    "mat_cholmod_factor": "supernodal",  # simplicial ones, of small matrices, would not tell it
    "mat_cholmod_nmethods": "3",  # the better of AMD and METIS: a plate's had 12 % fewer entries
}
AMD_ALONE = {"mat_cholmod_nmethods": "2"}


def has_cholmod() -> bool:
    """Whether PETSc has CHOLMOD."""
    has = PETSc.Sys.hasExternalPackage
    return bool(has("cholmod") or has("suitesparse"))


def cholmod_solver(comm: PETSc.Comm, prefix: str) -> PETSc.KSP:
    """A solver with CHOLMOD's factors once there are any; the caller destroys it.

    Args:
        comm: Communicator of one rank.
        prefix: Prefix of its options.
    """
    ksp = PETSc.KSP().create(comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.CHOLMOD)
    ksp.setFromOptions()
    return ksp


def cholmod_factor(ksp: PETSc.KSP, S: PETSc.Mat, brief: bool = False) -> bool:
    """Factor a matrix; false if it has no such factors, and the solver is of no use any more.

    Args:
        ksp: The solver.
        S: A symmetric matrix.
        brief: Whether the factors serve for few solves: METIS is not asked for an order then.
    """
    ksp.setOperators(S)
    try:
        with default_options(ksp.getOptionsPrefix(), **(DEFAULTS | (AMD_ALONE if brief else {}))):
            ksp.setUp()
    except PETSc.Error:  # not definite; or too large for CHOLMOD's integers, or the memory
        return False
    return True


def solver_of(A: PETSc.Mat, brief: bool = False) -> PETSc.KSP:
    """A solver with kept factors of a symmetric, definite matrix, which it owns. Collective.

    Args:
        A: The matrix.
        brief: Whether the factors serve for few solves, or have few entries.
    """
    A.setOption(PETSc.Mat.Option.SPD, True)
    if A.comm.size == 1 and has_cholmod():
        ksp = cholmod_solver(A.comm, PREFIX)
        if cholmod_factor(ksp, A, brief=brief or A.size[0] <= BRIEF):
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

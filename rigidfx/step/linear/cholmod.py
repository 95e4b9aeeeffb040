"""Cholesky's factors of symmetric matrices, by CHOLMOD: of one rank, or on each rank of the whole.

MUMPS has these, too, and divides them among ranks; a solve with those of CHOLMOD takes .76 of its
time at 24 321 unknowns of a bar, .6 at 6321 and a quarter at 1575, and they are made as fast. On
several ranks each has all of the factors, for which a matrix has to be small.
"""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.step.linear.linear_solver import default_options

__all__ = ["exists", "factor", "solver"]

DEFAULTS = {
    "mat_cholmod_print": "0",  # that a matrix is not definite is an answer here
    "mat_cholmod_factor": "supernodal",  # simplicial ones, of small matrices, would not tell it
    "mat_cholmod_nmethods": "3",  # the better of AMD and METIS: a plate's had 12 % fewer entries
}
OF_EACH = {  # the same for the copy that each of several ranks has
    "redundant_pc_type": "cholesky",
    "redundant_pc_factor_mat_solver_type": "cholmod",
    **{f"redundant_{name}": value for name, value in DEFAULTS.items()},
}


def exists() -> bool:
    """Whether PETSc has it."""
    has = PETSc.Sys.hasExternalPackage
    return bool(has("cholmod") or has("suitesparse"))


def solver(comm: PETSc.Comm, prefix: str) -> PETSc.KSP:
    """What solves with its factors once there are any; the caller destroys it.

    Args:
        comm: Communicator of the matrix.
        prefix: Prefix of its options.
    """
    ksp = PETSc.KSP().create(comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    if comm.size == 1:
        ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
        ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.CHOLMOD)
    else:
        ksp.getPC().setType(PETSc.PC.Type.REDUNDANT)
    ksp.setFromOptions()
    return ksp


def factor(ksp: PETSc.KSP, S: PETSc.Mat) -> bool:
    """Factor a matrix; false if it has no such factors, and the solver is of no use any more.

    Collective, as is the answer.

    Args:
        ksp: The solver.
        S: A symmetric matrix.
    """
    ksp.setOperators(S)
    comm, made = ksp.comm.tompi4py(), True
    try:
        with default_options(ksp.getOptionsPrefix(), **(DEFAULTS if comm.size == 1 else OF_EACH)):
            ksp.setUp()
    except PETSc.Error:  # not definite; or too large for CHOLMOD's integers, or the memory
        made = False
    return bool(comm.allreduce(made, op=MPI.LAND))

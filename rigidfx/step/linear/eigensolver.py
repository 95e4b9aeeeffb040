"""SLEPc's solver for the lowest eigenvalues, with the factors of K + σM or by LAPACK.

On one rank CHOLMOD factors a definite K + σM, where it is installed, and MUMPS any other by LDLᵀ.
"""

from __future__ import annotations

from typing import Any

from petsc4py import PETSc

from rigidfx.base.errors import SceneError
from rigidfx.step.linear import cholmod
from rigidfx.step.linear.linear_solver import PREFIX, default_options

__all__ = ["MOST", "check_installed", "eigensolver"]

MOST = 1000  # restarts of the iteration
OWN = PREFIX + "modes_"  # prefix of the options of the solver with K + σM


def check_installed() -> Any:
    """The module SLEPc.

    Raises:
        SceneError: If it is not installed.
    """
    try:
        from slepc4py import SLEPc
    except ImportError as error:
        raise SceneError(
            "modes: SLEPc's Python package slepc4py is not installed. Debian has it as "
            "python3-slepc4py-real, conda-forge as slepc4py."
        ) from error
    return SLEPc


def eigensolver(
    K: PETSc.Mat, M: PETSc.Mat, shift: float | None, count: int, tolerance: float
) -> Any:
    """An EPS object of SLEPc for K φ = λ M φ; the caller destroys it. Collective.

    Args:
        K: Symmetric stiffness.
        M: Symmetric positive definite mass.
        shift: σ [1/s²]; None to find all pairs at once by LAPACK, on each rank.
        count: Pairs that are asked for at first, which size the space of the iteration.
        tolerance: Relative residual at which a pair has converged.
    """
    slepc = check_installed()
    if shift is None:
        eps = _plain(slepc, K, M)
        eps.setType(slepc.EPS.Type.LAPACK)
        eps.setWhichEigenpairs(slepc.EPS.Which.SMALLEST_REAL)
        return eps
    if K.comm.size == 1 and cholmod.exists():
        eps = _inverting(slepc, K, M, shift, tolerance, PETSc.Mat.SolverType.CHOLMOD)
        eps.setDimensions(count)
        try:
            with default_options(OWN, **cholmod.DEFAULTS):
                eps.setUp()
            return eps
        except PETSc.Error:  # K + σM is not definite
            eps.destroy()
    return _inverting(slepc, K, M, shift, tolerance, PETSc.Mat.SolverType.MUMPS)


def _plain(slepc: Any, K: PETSc.Mat, M: PETSc.Mat) -> Any:
    """SLEPc's solver with its operators."""
    eps = slepc.EPS().create(K.comm)
    eps.setOperators(K, M)
    eps.setProblemType(slepc.EPS.ProblemType.GHEP)
    return eps


def _inverting(
    slepc: Any, K: PETSc.Mat, M: PETSc.Mat, shift: float, tolerance: float, package: str
) -> Any:
    """SLEPc's solver by shift and invert, with factors by some package."""
    eps = _plain(slepc, K, M)
    eps.setType(slepc.EPS.Type.KRYLOVSCHUR)
    eps.setTarget(-shift)
    eps.setWhichEigenpairs(slepc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTolerances(tolerance, MOST)
    eps.setPurify(False)  # the Ritz step does more
    st = eps.getST()
    st.setType(slepc.ST.Type.SINVERT)
    ksp = st.getKSP()
    ksp.setOptionsPrefix(OWN)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType(package)
    return eps

"""Linear solvers: direct for small systems, Krylov with a fall-back to direct for large ones.

Small systems of one rank are factored by PETSc itself where inertia makes their diagonals large; it
hardly looks for pivots. Elsewhere MUMPS does. Symmetric, definite matrices that serve for many
solves have factors by CHOLMOD on one rank. Defaults are set through PETSc's interface before its
options are read, so that every option under the project's prefix overrides them.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

from rigidfx.base.errors import StepError

PREFIX = "rigidfx_"
OF_DEFINITE = PREFIX + "definite_"  # prefix of the options of `solver_of`
FORMER = PREFIX + "error_"  # its former name, whose options still count
DIRECT_BELOW = 100  # unknowns up to which LU costs no more than GMRES, and it never gives up
QUICK_UP_TO = 500  # unknowns; beyond, LU by PETSc is hardly ever cheaper than by MUMPS
KRYLOV_RTOL = 1e-8
RIGHT_SIDED = ("gmres", "fgmres", "lgmres", "dgmres", "pgmres", "gcr", "bcgs", "bcgsl", "tfqmr")
BRIEF = 10_000  # unknowns up to which METIS takes more time than its order saves
CHOLMOD = {
    "mat_cholmod_print": "0",  # that a matrix is not definite is an answer here
    "mat_cholmod_factor": "supernodal",  # simplicial ones, of small matrices, would not tell it
    "mat_cholmod_nmethods": "3",  # the better of AMD and METIS: a plate's had 12 % fewer entries
}
AMD_ALONE = {"mat_cholmod_nmethods": "2"}
MUMPS = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}


@contextmanager
def default_options(prefix: str, **defaults: str) -> Iterator[None]:
    """Put options that the user has not set into PETSc's database, and take them out again.

    They are values by name, for the object of a prefix that is configured meanwhile.
    """
    options = PETSc.Options(prefix)
    mine = [name for name in defaults if not options.hasName(name)]
    for name in mine:
        options[name] = defaults[name]
    try:
        yield
    finally:
        for name in mine:
            options.delValue(name)


def krylov_limit(unknowns: int) -> int:
    """Krylov iterations after which a step turns to a factorisation.

    Measured on one core with blocked matrices: an LU by MUMPS costs as much as some 230 iterations
    of GMRES with ILU(0) at 4·10³ unknowns and 310 at 2.7·10⁴. The limit stays below and grows like
    the square root; beyond 2.7·10⁴ it is an extrapolation.
    """
    return max(60, round(unknowns**0.53))


def configure(
    ksp: PETSc.KSP, direct: bool, unknowns: int, bodies: bool, quick: bool = False
) -> None:
    """Set a solver up, then let PETSc's options have their say. Collective.

    It is LU if `direct`, else GMRES preconditioned by incomplete factors of each rank's block. The
    last unknowns may be those of bodies. A quick LU is PETSc's own, which hardly looks for pivots.
    """
    pc, alone = ksp.getPC(), ksp.comm.size == 1
    pc.reset()
    if direct:
        ksp.setType(PETSc.KSP.Type.PREONLY)
        pc.setType(PETSc.PC.Type.LU)
        if quick and alone:
            pc.setFactorSolverType(PETSc.Mat.SolverType.PETSC)
            order, has = PETSc.Mat.OrderingType, PETSc.Sys.hasExternalPackage
            # The one of these that there is with the fewest entries of factors.
            amd = has("amd") or has("suitesparse")
            pc.setFactorOrdering(order.AMD if amd else order.QMD)
        else:
            pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    else:
        ksp.setType(PETSc.KSP.Type.GMRES)
        # On this side the residual that ends the iteration is that of the system itself. The
        # preconditioned one vanishes at once where the incomplete factors are all but singular.
        if PETSc.Options(PREFIX).getString("ksp_type", "gmres") in RIGHT_SIDED:
            ksp.setPCSide(PETSc.PC.Side.RIGHT)
        limit = krylov_limit(unknowns)
        ksp.setGMRESRestart(min(limit, 100))
        ksp.setTolerances(rtol=KRYLOV_RTOL, atol=0.0, max_it=limit)
        pc.setType(PETSc.PC.Type.ILU if alone else PETSc.PC.Type.BJACOBI)
        if alone:
            # Dense rows are best left to the end. With a body RCM takes between 2 % fewer and a
            # quarter more iterations than the mesh's own order; without one that takes 2 to 12 %
            # more.
            order = PETSc.Mat.OrderingType
            pc.setFactorOrdering(order.NATURAL if bodies else order.RCM)
    ksp.setFromOptions()


def forget_failed(ksp: PETSc.KSP) -> None:
    """Renew factors that have failed: MUMPS would raise an error of its own. Collective."""
    pc = ksp.getPC()
    if ksp.comm.tompi4py().allreduce(int(pc.getFailedReason())):
        pc.reset()


def has_cholmod() -> bool:
    """Whether PETSc has CHOLMOD."""
    has = PETSc.Sys.hasExternalPackage
    return bool(has("cholmod") or has("suitesparse"))


def cholmod_solver(comm: PETSc.Comm, prefix: str) -> PETSc.KSP:
    """A solver of one rank with CHOLMOD's factors once there are any; the caller destroys it."""
    ksp = PETSc.KSP().create(comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.CHOLMOD)
    ksp.setFromOptions()
    return ksp


def cholmod_factor(ksp: PETSc.KSP, S: PETSc.Mat, brief: bool = False) -> bool:
    """Factor a symmetric matrix; false if it has no such factors, and the solver is of no use.

    METIS is not asked for an order of brief factors, which serve for few solves.
    """
    ksp.setOperators(S)
    try:
        with default_options(ksp.getOptionsPrefix(), **(CHOLMOD | (AMD_ALONE if brief else {}))):
            ksp.setUp()
    except PETSc.Error:  # not definite; or too large for CHOLMOD's integers, or the memory
        return False
    return True


def solver_of(A: PETSc.Mat, brief: bool = False) -> PETSc.KSP:
    """A solver with kept factors of a symmetric, definite matrix, which it owns. Collective.

    Brief factors serve for few solves, or have few entries.
    """
    A.setOption(PETSc.Mat.Option.SPD, True)
    with default_options(OF_DEFINITE, **PETSc.Options(FORMER).getAll()):
        ksp = _factored(A, brief or A.size[0] <= BRIEF)
    A.destroy()  # its solver holds it
    return ksp


def _factored(A: PETSc.Mat, brief: bool) -> PETSc.KSP:
    """A solver with the factors of a definite matrix by CHOLMOD, or by MUMPS. Collective."""
    if A.comm.size == 1 and has_cholmod():
        ksp = cholmod_solver(A.comm, OF_DEFINITE)
        if cholmod_factor(ksp, A, brief):
            return ksp
        ksp.destroy()
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOptionsPrefix(OF_DEFINITE)
    ksp.setOperators(A)
    with default_options(OF_DEFINITE, **MUMPS):
        ksp.setFromOptions()
    ksp.setUp()
    return ksp


def conjugate_gradients(mass: PETSc.Mat, rhs: PETSc.Vec, x: PETSc.Vec) -> None:
    """Solve a well-conditioned system to rounding, or raise a `StepError`. Collective."""
    ksp = PETSc.KSP().create(rhs.comm)
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.getPC().setType(PETSc.PC.Type.JACOBI)
    ksp.setTolerances(rtol=1e-15, atol=0.0, max_it=10_000)
    ksp.setOperators(mass)
    ksp.solve(rhs, x)
    reason = ksp.getConvergedReason()
    ksp.destroy()
    if reason <= 0:
        raise StepError("The velocities could not be adapted to a support or to rigid bodies.")

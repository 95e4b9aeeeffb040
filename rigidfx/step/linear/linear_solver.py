"""Which linear solver: direct for small systems, Krylov with a fall-back to direct for large ones.

Small systems of one rank are factored by PETSc itself where inertia makes their diagonals large: it
looks for pivots in blocks of three unknowns at most. Elsewhere MUMPS looks for them everywhere.

Defaults are set through PETSc's interface before its options are read, so that every option under
the project's prefix overrides them: -rigidfx_ksp_type, -rigidfx_pc_type, -rigidfx_snes_monitor.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

from rigidfx.base.errors import StepError

PREFIX = "rigidfx_"
# With the preconditioner on the left, a step by LU took 2.4 ms at 78, 3.9 ms at 150 and 5.0 ms at
# 258 unknowns; by GMRES 2.3, 3.2 and 3.8 ms. Up to here LU costs no more, and it never gives up.
DIRECT_BELOW = 100  # unknowns
# LU by MUMPS took 0.02 ms at 6 unknowns, 0.40 at 258, 0.72 at 426 and 1.5 ms at 636, by PETSc
# 0.001, 0.20, 0.41 and 1.3 ms; a solve with the factors 0.013 to 0.07 ms, by PETSc 0.001 to 0.02.
QUICK_UP_TO = 500  # unknowns; beyond, new factors are hardly ever cheaper
KRYLOV_RTOL = 1e-8
RIGHT_SIDED = ("gmres", "fgmres", "lgmres", "dgmres", "pgmres", "gcr", "bcgs", "bcgsl", "tfqmr")


@contextmanager
def default_options(prefix: str, **defaults: str) -> Iterator[None]:
    """Put options that the user has not set into PETSc's database, and take them out again.

    Args:
        prefix: Prefix of the object that is configured meanwhile.
        defaults: Values by option name, without the prefix.
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


def prefers_direct(unknowns: int) -> bool:
    """Whether a factorisation is the faster way for so many unknowns."""
    return unknowns < DIRECT_BELOW


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

    Args:
        ksp: Solver to be set up.
        direct: LU if true, else GMRES preconditioned by incomplete factors of each rank's block.
        unknowns: Size of the system.
        bodies: Whether its last unknowns are those of rigid bodies.
        quick: Whether LU is PETSc's own, which hardly looks for pivots, where there is one rank.
    """
    pc = ksp.getPC()
    pc.reset()
    if direct:
        ksp.setType(PETSc.KSP.Type.PREONLY)
        pc.setType(PETSc.PC.Type.LU)
        if quick and ksp.comm.size == 1:
            pc.setFactorSolverType(PETSc.Mat.SolverType.PETSC)
            pc.setFactorOrdering(_ordering())
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
        if ksp.comm.size == 1:
            pc.setType(PETSc.PC.Type.ILU)
            # Dense rows are best left to the end. With a body RCM takes between 2 % fewer and a
            # quarter more iterations than the mesh's own order; without one that takes 2 to 12 %
            # more.
            order = PETSc.Mat.OrderingType
            pc.setFactorOrdering(order.NATURAL if bodies else order.RCM)
        else:
            pc.setType(PETSc.PC.Type.BJACOBI)
    ksp.setFromOptions()


def forget_failed(ksp: PETSc.KSP) -> None:
    """Renew factors that have failed: MUMPS would raise an error of its own. Collective."""
    pc = ksp.getPC()
    if ksp.comm.tompi4py().allreduce(int(pc.getFailedReason())):
        pc.reset()


def _ordering() -> str:
    """The ordering with the fewest entries of factors that there is."""
    order, has = PETSc.Mat.OrderingType, PETSc.Sys.hasExternalPackage
    return order.AMD if has("amd") or has("suitesparse") else order.QMD


def conjugate_gradients(mass: PETSc.Mat, rhs: PETSc.Vec, x: PETSc.Vec) -> None:
    """Solve a well-conditioned system to rounding, as reduced mass matrices are. Collective.

    Raises:
        StepError: If it does not converge.
    """
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

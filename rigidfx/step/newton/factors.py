"""Solve with the factors of a tangent, for as long as it stays the one that was factored.

Small systems have LU by PETSc itself where inertia makes pivots needless; others Cholesky's factors
of the symmetric part on one rank, until a tangent has been found to be too far from that; all
others LU by MUMPS. Where inertia is large, GMRES with incomplete factors takes a handful of
iterations to a hundredth, each of a third of a solve with full factors, or less. Newton's iteration
with a kept tangent removes the error of a solve, as it does the tangent's own error.
"""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.matrices import free
from rigidfx.linear import linear_solver
from rigidfx.linear.linear_solver import PREFIX, configure, default_options
from rigidfx.step.equations.equations import Equations

OF_CHOLESKY, OF_INCOMPLETE = PREFIX + "cholesky_", PREFIX + "incomplete_"  # of their options
REDUCTION = 1e-2  # of the residual in a solve with incomplete factors
MAX_ITERATIONS = 100
# Skew part, relative to all of a tangent, in Frobenius' norm. A residual falls to 2 to 14 times
# that in an iteration.
SKEW = 2e-3
UNKNOWN = PETSc.Mat.Structure.UNKNOWN_NONZERO_PATTERN  # PETSc compares them: the same, as a rule


class Prices:
    """Costs of entries.

    The unit is the time of an iteration, without its solve, for each entry of the tangent: 1.8 ns.
    Costs come from counts that all numbers of ranks have alike, not from a clock, so runs repeat
    exactly. In parts of steel of 10⁴ to 2·10⁴ unknowns an entry of Cholesky's factors took 12 to 14
    in factoring and .63 to .8 in a solve, an entry of a tangent 13 in assembly, for which cells
    bring 2.4. Beside a body each of these is multiplied by the body's coordinates, four and three
    for each shape.
    """

    ASSEMBLING = 5.5  # to assemble an entry of a cell
    MAKING = 13.0  # to make an entry of factors
    CONDENSING = 0.5  # to multiply an entry of a cell by a coordinate of a body, some 1 ns
    SOLVING = 0.75  # to solve with an entry of factors
    CALLS = 65e3  # all calls of an iteration


def price(equations: Equations, filled: float) -> float:
    """Cost of a new tangent whose factors have `filled` entries, in iterations. Collective."""
    own, p = entries_of(equations.tangent_matrix), equations.prolongation
    layout = p.layout
    parts = layout.interior, layout.interface
    counts = np.array([sum(map(len, cells_of.values())) for cells_of in parts])
    p.comm.Allreduce(MPI.IN_PLACE, counts)
    of_cells = counts * (3 * layout.space.dofmap.list.shape[1]) ** 2
    condensing = Prices.CONDENSING * layout.ensemble.frozen.shape[1] * of_cells[1]
    cost = Prices.ASSEMBLING * of_cells.sum() + Prices.MAKING * filled + condensing
    return float(cost / (own + Prices.CALLS + Prices.SOLVING * filled))


def entries_of(A: PETSc.Mat) -> float:
    """Entries of a matrix on all ranks. Collective."""
    return float(A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"])


class Cholesky:
    """Factors of the symmetric part of one matrix; `destroy` frees them.

    The forces of a step act at its middle, its strains are measured at its end. So the skew part of
    a tangent grows with the rotation and strain in half a step, and is small in vibrations.
    Newton's iteration with a kept tangent removes the error by the missing skew part. Cholesky's
    factors have half of the entries of LU, which halves the time of a solve and of a new tangent.
    They do not exist if the matrix is not definite, as near buckling.

    Options of PETSc's are understood under the prefix `rigidfx_cholesky_`.

    Attributes:
        ksp: Solves with them once there are any.
    """

    def __init__(self, A: PETSc.Mat) -> None:
        """Set the solver of a matrix of one rank up."""
        self._A = A
        self._transposed, self._symmetric = PETSc.Mat(), PETSc.Mat()
        self._entries = 0.0
        self.ksp = linear_solver.cholmod_solver(A.comm, OF_CHOLESKY)

    def renew(self) -> bool:
        """Factor the matrix as it is now; false if it is too far from symmetric, or not definite.

        If false, it cannot be used any more.
        """
        entries = entries_of(self._A)
        if entries != self._entries:  # the pattern is new, or has grown
            self._entries = entries
            free(self._transposed, self._symmetric)
        self._A.transpose(self._transposed)
        self._transposed.axpy(1.0, self._A, UNKNOWN)
        self._transposed.scale(0.5)
        whole, symmetric = self._A.norm(), self._transposed.norm()
        if not whole - symmetric <= 0.5 * SKEW**2 * whole:  # as ‖A‖² = ‖sym A‖² + ‖skw A‖²
            return False
        self._transposed.convert(PETSc.Mat.Type.AIJ, self._symmetric)
        return linear_solver.cholmod_factor(self.ksp, self._symmetric)

    def destroy(self) -> None:
        """Free factors and matrices."""
        free(self.ksp, self._transposed, self._symmetric)


class Factors:
    """LU of a tangent, or Cholesky's factors; `destroy` frees them.

    Attributes:
        renewal: Cost of a new tangent, its factors included, in iterations with these; 0 before
            there are some.
        iterations: How many the last solve counts as.
    """

    iterations = 1

    def __init__(self, equations: Equations) -> None:
        """Create the solver for the tangent of some equations. Collective."""
        self.renewal = 0.0
        self._equations, comm = equations, equations.prolongation.comm
        self._quick = False
        self._ksp = PETSc.KSP().create(comm)
        one = comm.size == 1 and linear_solver.has_cholmod()
        self._cholesky = Cholesky(equations.tangent_matrix) if one else None
        self._take_pivots(True)

    def _take_pivots(self, pivots: bool) -> None:
        self._pivots, p = pivots, self._equations.prolongation
        self._quick = not pivots and p.size <= linear_solver.QUICK_UP_TO
        configure(self._ksp, True, p.size, len(p.layout.bodies) > 0, self._quick)
        self._ksp.setOperators(self._equations.tangent_matrix)

    @property
    def _present(self) -> PETSc.KSP:
        """The solver."""
        return self._ksp if self._quick or self._cholesky is None else self._cholesky.ksp

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._present.getType()}+{self._present.getPC().getType()}"

    def renew(self) -> None:
        """Factor a new tangent, and choose the solver. Collective."""
        if self._pivots == self._equations.well_conditioned:
            self._take_pivots(not self._pivots)
        self.renewal = price(self._equations, entries_of(self._made()))

    def _made(self) -> PETSc.Mat:
        """Make the factors. Collective."""
        if not self._quick and self._cholesky is not None:
            if self._cholesky.renew():
                return self._cholesky.ksp.getPC().getFactorMatrix()
            self._cholesky.destroy()
            self._cholesky = None
        self._ksp.setUp()
        return self._ksp.getPC().getFactorMatrix()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r, or nearly so. Collective."""
        self._present.solve(r, z)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        free(self._ksp, self._cholesky)


class IncompleteFactors:
    """GMRES with incomplete factors of each rank's rows; `destroy` frees it.

    Options of PETSc's are understood under the prefix `rigidfx_incomplete_`.

    Attributes:
        renewal: Cost of a new tangent, its factors included, in iterations with these.
    """

    # 3 at 700 unknowns, 7 at 4000, 4 at 27 000; 8 to 12 with a coarse grid, beyond 100 000
    renewal = 5.0

    def __init__(self, equations: Equations) -> None:
        """Create the solver for the tangent of some equations. Collective."""
        p = equations.prolongation
        bodies = len(p.layout.bodies) > 0
        self._ksp = PETSc.KSP().create(p.comm)
        self._ksp.setOptionsPrefix(OF_INCOMPLETE)
        self._defaults: dict[str, str] = {}
        if p.comm.size > 1:  # with the rows round its own, in the order that one rank takes
            self._defaults = {"pc_type": "asm", "pc_asm_overlap": "1"}
            self._defaults["sub_pc_factor_mat_ordering_type"] = "natural" if bodies else "rcm"
        with default_options(OF_INCOMPLETE, **self._defaults):
            configure(self._ksp, False, p.size, bodies)
            # This kind keeps what the factors have made of each direction, and spares a solve with
            # them at the end: one in five.
            self._ksp.setType(PETSc.KSP.Type.FGMRES)
            self._ksp.setTolerances(rtol=REDUCTION, atol=0.0, max_it=MAX_ITERATIONS)
            self._ksp.setFromOptions()
        self._ksp.setOperators(equations.tangent_matrix)

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
        with default_options(OF_INCOMPLETE, **self._defaults):  # blocks are told when they are made
            self._ksp.setUp()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """A z = r, to a hundredth. Collective."""
        self._ksp.solve(r, z)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()

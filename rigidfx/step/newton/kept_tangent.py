"""Solve linear systems by a tangent of an earlier iterate, turned along with the structure.

Corrections are z = Q A₀⁻¹ Qᵀ r, Q = R R₀ᵀ, with the rotations R of nodes and bodies at the start of
the step (`Frames`) and R₀ of that in which A₀ was assembled. Contacts are followed by a correction
of low rank, and secants mend what the tangent lacks: docs/theory/step.md#kept-tangents.
"""

import numpy as np
from dolfinx import la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import csc_array, csr_array

from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.contacts.surface import STALE
from rigidfx.mechanics.local_rotations import LocalRotations, turn_vectors
from rigidfx.mechanics.rotation import AXES, IDENTITY
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.border import Border, Solve
from rigidfx.step.newton.factors import Factors, IncompleteFactors

NEAR = 0.1  # change of Δt that a tangent survives
Inverse = Factors | IncompleteFactors  # solvers with a tangent that has been assembled once
PAIRS = 6  # that are kept
INDEPENDENT = 1e-4  # square of the part in which pairs have to differ


class Frames:
    """How nodes and bodies have turned, and unknowns turned along with them.

    A ≈ Q A₀ Qᵀ is exact for parts in steady rigid rotation, and right up to curvature times cell
    size in parts that bend. Increments of a node and residuals at it turn as vectors, and so do Δr
    and ℓθ of a body. Coordinates of shapes do not turn. A node that supports hold in part keeps its
    directions.

    Attributes:
        starts: Where vectors of three among this rank's unknowns begin.
    """

    def __init__(self, prolongation: Prolongation) -> None:
        """Find where vectors of unknowns begin. Collective."""
        self._p, layout = prolongation, prolongation.layout
        parts = [np.empty(0, dtype=np.int32), *layout.flexible.values()]
        cells = layout.space.dofmap.list[np.concatenate(parts)]
        X = layout.space.tabulate_dof_coordinates()
        self._local = LocalRotations(cells, X, prolongation.comm)
        self._spread = la.vector(layout.space.dofmap.index_map, 9)
        self._nodes = layout.rows.nodes
        self._fitted = np.broadcast_to(IDENTITY, (self._nodes.size, 3, 3)).copy()
        free = prolongation.free_of_nodes
        self._whole = free.all(axis=1)
        first = (np.cumsum(free.reshape(-1)).reshape(-1, 3) - 1)[self._whole, 0]
        bodies = prolongation.six[:, ::3].reshape(-1)
        self.starts = np.concatenate([first, bodies]).astype(np.int32)

    def rotations(self, u: Array) -> Array:
        """Rotation of each vector of unknowns of this rank, shape (vectors, 3, 3). Collective.

        u is the displacement of all local nodes, ghosts included, one number per dof [m].
        """
        M = self._spread.array.reshape(-1, 9)
        M[:] = 0.0
        self._local.spread(u, M)
        self._spread.scatter_reverse(la.InsertMode.add)
        self._local.fit(M[self._nodes], self._fitted)
        nodes = self._p.at_nodes(self._fitted.reshape(-1, 9)).reshape(-1, 3, 3)
        bodies = self._p.increments.start.R[self._p.moving]
        return np.concatenate([nodes[self._whole], np.repeat(bodies, 2, axis=0)])


class Secants:
    """Mends the corrections of a kept tangent by known pairs of s and Δz: docs/theory/step.md, (4).

    Parts that bend stay near the shape of a step before. So pairs are kept over steps, in the frame
    of the tangent, until there is a new one.
    """

    def __init__(self, comm: MPI.Intracomm, size: int) -> None:
        """Begin without pairs of vectors of which this rank owns `size` unknowns."""
        self._comm = comm
        self._pairs = np.zeros((2, PAIRS, size))  # Δz and s - Δz
        self.forget()

    def forget(self) -> None:
        """Drop all pairs: there is a new tangent."""
        self._learned = 0
        self.begin()

    def begin(self) -> None:
        """Begin the iterates of a step, or of an attempt at it."""
        self._last: tuple[Array, Array] | None = None

    def mend(self, z: Array, learning: bool) -> None:
        """Improve the kept tangent's correction z in place by the known pairs. Collective.

        A pair is learned from it if `learning`. Pairs of mere rounding made steps of a plate that
        hardly strains fail.
        """
        given = z.copy()
        if learning and self._last is not None:
            before, taken = self._last
            change = given - before
            self._pairs[:, self._learned % PAIRS] = change, -taken - change
            self._learned += 1
        if self._learned:
            changes, mending = self._pairs[:, : self._learned]
            z += self._coefficients(changes, given) @ mending
        self._last = given, z.copy()

    def _coefficients(self, changes: Array, given: Array) -> Array:
        """c of each pair."""
        products = np.empty((len(changes), len(changes) + 1))
        with np.errstate(over="ignore", invalid="ignore"):
            products[:, :-1], products[:, -1] = changes @ changes.T, changes @ given
        self._comm.Allreduce(MPI.IN_PLACE, products)
        sizes = np.sqrt(products.diagonal())
        if not (np.isfinite(sizes).all() and sizes.all()):
            return np.zeros(len(sizes))  # what overflows is no step
        products /= sizes[:, None]
        # As numpy's pinv, of whose time this takes a quarter: an eighth of small models' steps.
        squares, parts = np.linalg.eigh(products[:, :-1] / sizes)
        differ = squares > INDEPENDENT * squares[-1]
        parts = parts[:, differ]
        return np.asarray(parts @ (products[:, -1] @ parts / squares[differ]) / sizes)


class LowRank:
    """Follows the stiffness of contacts by one kept tangent; `destroy` frees its vectors.

    A contact that opens or closes changes the tangent by Δ = Qᵀ K Q - K₀ ≈ B Bᵀ Δ. K is the
    stiffness of contacts at the last iterate, K₀ that in A, Q the rotation of the unknowns since A
    was assembled. B has one column for each node that a plane without friction presses. A column
    takes one solve. It serves as long as A does, however often the contact changes there.

    Attributes:
        columns: How many B has.
    """

    def __init__(self, prolongation: Prolongation, starts: Ints) -> None:
        """Begin without a tangent. Vectors among this rank's unknowns begin at `starts`."""
        self._comm, self._starts = prolongation.comm, starts.astype(np.int64)
        self._right, self._left = (prolongation.unknowns() for _ in range(2))
        self._first, self._owned = prolongation.first_column, prolongation.owned
        self.renewed(None)

    def renewed(self, entries: csr_array | None) -> None:
        """Record a new tangent with K₀, equal on all ranks; None if nothing may jump."""
        self._then = self._now = entries
        self._rows: Ints = np.empty(0, np.int64)  # unknowns at which B has entries
        self._B: Array = np.empty((0, 0))  # there
        self._Y: Array = np.empty((0, self._owned))  # transposed
        self._C: Array = np.empty((0, 0))  # Y at these unknowns
        self._W: Array = np.empty((0, 0))
        self._factors: tuple[Array, Array] | None = None
        self.columns = 0

    def follow(
        self, entries: csr_array, Q: Array | None, factor: float, most: float, solve: Solve
    ) -> bool:
        """Follow the stiffness K of contacts at the last iterate, equal on all ranks. Collective.

        Vectors of unknowns have turned by Q since the tangent was assembled, and solutions with it
        are multiplied by a factor. False if it takes more than `most` columns: a new tangent is
        due.
        """
        if self._then is None:
            return False
        rows, change, scale = self._change(entries, Q, factor)
        B = np.zeros((rows.size, self.columns))
        B[np.searchsorted(rows, self._rows)] = self._B
        new = _basis(change, B, STALE * scale, most - self.columns)
        if new is None:
            return False
        self._now, self._rows, self._B = entries, rows, np.c_[B, new]
        self._extend(new, solve)
        self._take(change)
        return True

    def turn(self, Q: Array | None, factor: float) -> None:
        """Follow a turn of the structure, or a change of Δt, as in `follow`. Collective."""
        if self.columns and self._now is not None:
            _, change, _ = self._change(self._now, Q, factor)
            self._take(change)

    def _change(
        self, now: csr_array, Q: Array | None, factor: float
    ) -> tuple[Ints, csr_array, float]:
        """Unknowns of contacts, Δ at these, and the largest entry of K and K₀. Collective."""
        then = self._then
        assert then is not None
        entries = (part.nonzero()[0] for part in (now, then))
        rows = self._whole(np.unique(np.concatenate([self._rows, *entries])).astype(np.int64))
        now, then = (part[rows][:, rows] for part in (now, then))
        scale = max(np.abs(part.data).max(initial=0.0) for part in (now, then))
        if Q is not None:
            turned = self._rotation(rows, Q)
            now = turned.T @ now @ turned
        return rows, csr_array(factor * now - then), float(scale)

    def _whole(self, rows: Ints) -> Ints:
        """Unknowns with all of the vectors that they are of. Collective."""
        turning = self._turning(np.ones((self._starts.size, 3, 3)))
        found = turning[rows[self._here(rows)] - self._first].indices.astype(np.int64) + self._first
        return np.unique(np.concatenate(self._comm.allgather(found)))

    def _here(self, rows: Ints) -> Bools:
        """Which unknowns are this rank's."""
        return np.asarray((rows >= self._first) & (rows < self._first + self._owned))

    def _turning(self, Q: Array) -> csr_array:
        """Q as a matrix of this rank's unknowns."""
        at = self._starts[:, None] + AXES
        alone = np.setdiff1d(np.arange(self._owned), at)
        i = np.concatenate([at.repeat(3, axis=1).ravel(), alone])
        j = np.concatenate([np.tile(at, 3).ravel(), alone])
        values = np.concatenate([Q.ravel(), np.ones(alone.size)])
        return csr_array((values, (i, j)), shape=(self._owned,) * 2)

    def _rotation(self, rows: Ints, Q: Array) -> csr_array:
        """Q at some unknowns, whole vectors. Collective."""
        here = np.flatnonzero(self._here(rows))
        own = self._turning(Q)[rows[here] - self._first].tocoo()
        i, j = here[own.coords[0]], np.searchsorted(rows, own.coords[1] + self._first)
        every = zip(*self._comm.allgather((own.data, i, j)), strict=True)
        values, i, j = (np.concatenate(parts) for parts in every)
        return csr_array((values, (i, j)), shape=(rows.size,) * 2)

    def _extend(self, new: Array, solve: Solve) -> None:
        """Find columns of Y. Collective."""
        here, Y = self._here(self._rows), np.empty((new.shape[1], self._owned))
        for k in range(new.shape[1]):
            self._right.set(0.0)
            self._right.array[self._rows[here] - self._first] = new[here, k]
            solve(self._right, self._left)
            Y[k] = self._left.array_r
        self.columns += new.shape[1]
        self._Y = np.concatenate([self._Y, Y])
        self._C = self._at_rows(self._Y).T

    def _at_rows(self, values: Array) -> Array:
        """Vectors at the unknowns of B, on all ranks, shape (…, rows). Collective."""
        here = self._here(self._rows)
        out = np.zeros((*values.shape[:-1], self._rows.size))
        out[..., here] = values[..., self._rows[here] - self._first]
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out

    def _take(self, change: csr_array) -> None:
        """Pick Δ at the unknowns of B."""
        self._W = np.asarray((change.T @ self._B).T)
        self._factors = lu_factor(np.eye(self.columns) + self._W @ self._C)

    def mend(self, z: PETSc.Vec) -> None:
        """Turn a solution with the tangent, in its frame, into a corrected one. Collective."""
        if self._factors is not None:
            z.array[:] -= lu_solve(self._factors, self._W @ self._at_rows(z.array_r)) @ self._Y

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        free(self._right, self._left)


def _basis(change: csr_array, B: Array, least: float, most: float) -> Array | None:
    """Columns that a basis B of a matrix lacks, by Gram and Schmidt with the largest one first.

    Columns of the matrix up to the length `least` need none. None if more than `most` are needed.
    """
    columns = csc_array(change)
    squares = np.asarray(columns.power(2).sum(axis=0)) - ((columns.T @ B) ** 2).sum(axis=1)
    new: list[Array] = []
    while squares.size and squares[(k := int(np.argmax(squares)))] > least**2:
        if len(new) + 1 > most:
            return None
        every = np.column_stack([B, *new])
        column = columns[:, [k]].toarray()[:, 0]
        for _ in range(2):  # the second time for what rounding has left
            column = column - every @ (every.T @ column)
        new.append(column / np.linalg.norm(column))
        squares -= (columns.T @ new[-1]) ** 2
    return np.column_stack([np.empty((len(B), 0)), *new])


class KeptTangent:
    """A preconditioner of PETSc's in Python: all of a linear solve, by kept factors.

    Attributes:
        inverse: Solves with the tangent.
        iterations: How many it has taken since the step began.
        learning: Whether the next correction tells something of the tangent.
    """

    def __init__(self, equations: Equations, inverse: Inverse) -> None:
        """Keep the solver of the tangent, which others fill. Collective."""
        self.inverse, self._border = inverse, Border(equations)
        self._frames = Frames(equations.prolongation)
        self._contacts = LowRank(equations.prolongation, self._frames.starts)
        self._right = equations.unknowns()
        self._secants = Secants(equations.prolongation.comm, self._right.getLocalSize())
        self._now: Array = np.empty((0, 3, 3))
        self._then: Array | None = None  # nothing is known, also on a rank without vectors
        self._Q: Array | None = None
        self._factor = 1.0
        self._dt = self._assembled_for = 0.0
        self.iterations, self.learning = 0, True

    def replace(self, inverse: Inverse) -> None:
        """Replace the inverse by one that has no tangent yet. Collective."""
        self.inverse.destroy()
        self.inverse, self._assembled_for = inverse, 0.0
        self._contacts.renewed(None)

    def fits(self, dt: float) -> bool:
        """Whether a step of Δt [s] is near enough to the one that the tangent was assembled for."""
        return abs(dt - self._assembled_for) <= NEAR * dt

    def begin(self, u: Array, dt: float) -> None:
        """Begin a step of Δt [s] from the displacement u of all local nodes [m]. Collective."""
        self.iterations = 0
        self._now = self._frames.rotations(u)
        self._Q = None if self._then is None else self._now @ self._then.swapaxes(1, 2)
        self._border.turn(self._frames.starts, self._Q)
        if dt != self._dt:
            self._secants.forget()
        self._secants.begin()
        # The inertial part of a tangent goes with 1/Δt², the elastic one stays: this is right in
        # the middle.
        self._dt, self._factor = dt, 2 / (1 + (self._assembled_for / dt) ** 2)
        self._contacts.turn(self._Q, self._factor)

    def _solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve in the frame of the tangent, without joints. Collective."""
        self.inverse.solve(r, z)
        self._contacts.mend(z)

    def follow(self, entries: csr_array) -> bool:
        """Update the tangent by the stiffness of contacts at the last iterate. Collective.

        False if a new tangent is as cheap; then nothing is changed.
        """
        most, solve = self.inverse.renewal, self.inverse.solve
        if not self._contacts.follow(entries, self._Q, self._factor, most, solve):
            return False
        self._secants.forget()
        self._border.renew(self._solve)
        return True

    def renewed(self, entries: csr_array | None) -> None:
        """Record a new tangent, and the stiffness of contacts in it. Collective."""
        self.inverse.renew()
        self._contacts.renewed(entries)
        self._border.renew(self.inverse.solve)
        self._secants.forget()
        self._then, self._Q = self._now, None
        self._assembled_for, self._factor = self._dt, 1.0

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call: z = Q A₀⁻¹ Qᵀ r. Collective."""
        r.copy(self._right)
        if self._Q is not None:
            turn_vectors(self._right.array, self._frames.starts, self._Q, True)
        self._border.solve(self._solve, self._right, z)
        if self._factor != 1.0:
            z.scale(self._factor)
        self._secants.mend(z.array, self.learning)
        if self._Q is not None:
            turn_vectors(z.array, self._frames.starts, self._Q, False)
        self.iterations += self.inverse.iterations

    def destroy(self, pc: PETSc.PC) -> None:
        """PETSc's call: free the inverse and the work vector. Collective."""
        free(self.inverse, self._contacts, self._right, self._border)

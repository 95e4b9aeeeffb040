"""Solve linear systems with joints by a solver for systems without: docs/theory/joints.md#solving.

Y = A⁻¹ E is found for each new tangent, and C = Eᵀ Y is the compliance at the ports. Entries of the
matrix and ports connect unknowns to parts: A⁻¹ e is zero outside the part of e, so that ports of
different parts share a solution. With a kept tangent, ports, Y and C rotate with
their nodes and bodies, and H, D and D₁ are those of the first iterate of a step; else of the
tangent's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from rigidfx.base.errors import StepError
from rigidfx.base.matrices import Matrix, Pattern, compact, dense, free, is_small
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.mechanics.rotation import AXES, nearest_rotations
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.factors import entries_of

Solve = Callable[[PETSc.Vec, PETSc.Vec], None]
Factors = Callable[[Array, Array], tuple[Array, Array]]


def small_system(C: Matrix, H: Matrix, D: Matrix, D1: Matrix, R: Array) -> Factors | None:
    """A function that finds f and μ of q₀ and s; None where the system is singular.

    With C the compliance at the ports, H the curvature of the rows, D and D₁ their derivatives on
    the test and on the trial side, and R the compliance of the rows,

        q + C f = q₀,    f = H q + Dᵀ μ,    D₁ q + R μ = s.

    Small systems are arrays, without f; larger ones are sparse, with f, as C H is full. Shapes are
    (ports, ports) of C and H, (rows, ports) of D and D₁, and (rows,) of R.
    """
    size = sum(D.shape)
    if is_small(size, size):
        return _by_arrays(dense(C), dense(H), dense(D), dense(D1), R)
    return _sparse(C, H, D, D1, R)


def _by_arrays(C: Array, H: Array, D: Array, D1: Array, R: Array) -> Factors | None:
    rows, n = D.shape
    if not n + rows:  # supports hold all that joints and springs take hold of
        return lambda q, s: (q, s)
    matrix = np.empty((n + rows,) * 2, order="F")
    matrix[:n, :n] = C @ H
    matrix[np.arange(n), np.arange(n)] += 1.0
    matrix[:n, n:] = C @ D.T
    matrix[n:, :n] = D1
    matrix[n:, n:] = np.diag(R)
    LU, pivots, singular = dgetrf(matrix, overwrite_a=True)

    def solve(q: Array, s: Array) -> tuple[Array, Array]:
        found, _ = dgetrs(LU, pivots, np.concatenate([q, s]))
        return H @ found[:n] + D.T @ found[n:], found[n:]

    return None if singular > 0 else solve


def _sparse(C: Matrix, H: Matrix, D: Matrix, D1: Matrix, R: Array) -> Factors | None:
    rows, n = D.shape
    k, ones, at = np.arange(n), np.ones(n), np.arange(rows)
    C, H, D, D1 = map(coo_array, (C, H, D, D1))
    (hi, hj), (di, dj), (ei, ej), (ci, cj) = H.coords, D.coords, D1.coords, C.coords
    row = k, ci, n + hi, n + k, n + dj, 2 * n + ei, 2 * n + at
    column = k, n + cj, hj, n + k, 2 * n + di, ej, 2 * n + at
    values = ones, C.data, H.data, -ones, D.data, D1.data, R
    places = np.concatenate(row), np.concatenate(column)
    try:
        factors = splu(csc_array((np.concatenate(values), places), shape=(2 * n + rows,) * 2))
    except RuntimeError:  # SuperLU's word for a singular matrix
        return None

    def solve(q: Array, s: Array) -> tuple[Array, Array]:
        found = factors.solve(np.concatenate([q, np.zeros(n), s]))
        return found[n : 2 * n], found[2 * n :]

    return solve


class Border:
    """Joints around a solver without them; `destroy` frees its vectors.

    Attributes:
        ports: Number of ports.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations, self._rows = equations, equations.constraints
        self.ports = 0
        if self._rows is None:
            return
        ports = self._rows.ports
        self.ports = ports.count
        self._E, self._ET = ports.entries, compact(csr_array(ports.entries.T))
        self._owned = equations.prolongation.owned
        self._r, self._z = (equations.prolongation.unknowns() for _ in range(2))
        self._Y: Matrix = csr_array((self._owned, self.ports))
        self._C: Matrix = np.zeros((0, 0))
        self._shared: Shared | None = None
        self._entries = 0.0  # of the tangent that it is of, whose pattern only grows
        self._turned: Matrix | None = None  # rotations of the ports, 3×3 each
        self._vectors = at = ports.vectors[:, None] + AXES
        shapes = np.setdiff1d(np.arange(self.ports), at)  # which do not turn
        self._still = shapes.size
        rows, columns = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        rows, columns = np.r_[rows.ravel(), shapes], np.r_[columns.ravel(), shapes]
        self._turning = Pattern(rows, columns, (self.ports, self.ports))
        self._weights: csr_array | None = None  # squares of shares of vectors in ports
        self._factors: Factors | None = None  # of the small system

    def renew(self, solve: Solve, ksp: PETSc.KSP | None = None) -> None:
        """Follow a new tangent with a solver; `ksp` if these are mere factors. Collective."""
        if self._rows is None:
            return

        def response(r: Array) -> Array:
            self._r.array[:] = r
            solve(self._r, self._z)
            return np.asarray(self._z.array_r)

        A = self._equations.tangent_matrix if ksp is None else ksp.getOperators()[0]
        entries, p = entries_of(A), self._equations.prolongation
        if self._shared is None or entries != self._entries:
            self._shared, self._entries = parted(A, self._E), entries
        self._Y = compact(self._shared.responses(response, ksp))
        own = self._ET @ self._Y
        self._C = own if p.comm.size == 1 else p.sum(dense(own))
        self._turned = self._factors = None

    def turn(self, starts: Indices, Q: Array | None) -> None:
        """Begin a step: vectors that begin at `starts` have turned by Q since. Collective."""
        if self._rows is None:
            return
        self._turned = self._factors = None
        if Q is None:
            return
        if self._weights is None:
            self._weights = csr_array(self._E[starts][:, self._vectors[:, 0]].power(2).T)
        sums = self._equations.prolongation.sum(self._weights @ Q.reshape(-1, 9)).reshape(-1, 3, 3)
        sums[np.abs(sums).max(axis=(1, 2)) == 0.0] = np.eye(3)  # nodes that are held in part
        values = np.concatenate([nearest_rotations(sums).ravel(), np.ones(self._still)])
        self._turned = self._turning.filled(values)

    def _factor(self) -> Factors:
        """Factors of the small system at the last iterate. Collective."""
        C, turned, rows = self._C, self._turned, self._rows
        assert rows is not None
        if turned is not None:
            C = turned @ C @ turned.T
        factors = small_system(C, *rows.border())
        if factors is None:
            given = (d.effect for d in rows.linkage.drives.each if d.effect.prescribes)
            motors = ", ".join(motor.owner for motor in given)
            raise StepError(
                "The joints and motors leave no motion, or hold what they hold already: their "
                f"equations are singular{f' (of given motion: {motors})' if motors else ''}.",
                "Look for motors that drive the same parts, or for a pose in which the mechanism "
                "locks; smaller steps may pass that.",
            )
        return factors

    def solve(self, solve: Solve, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Overwrite z by the solution for r with joints, by a solver without. Collective."""
        if self._rows is None:
            solve(r, z)
            return
        turned = self._turned
        self._r.array[:] = r.array_r[: self._owned]
        solve(self._r, self._z)
        q = self._equations.prolongation.sum(self._ET @ self._z.array_r)
        if turned is not None:
            q = turned @ q
        if self._factors is None:
            self._factors = self._factor()
        f, multipliers = self._factors(q, self._rows.of_rows(r.array_r))
        if turned is not None:
            f = turned.T @ f
        out = z.array
        out[: self._owned] = self._z.array_r - self._Y @ f
        out[self._owned :] = multipliers[: out.size - self._owned]

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        if self._rows is not None:
            free(self._r, self._z)


class BorderedFactors:
    """A preconditioner of PETSc's in Python: all of a linear solve, by factors of each tangent.

    Attributes:
        inner: Solves without joints.
    """

    def __init__(self, equations: Equations) -> None:
        """Create the solver within. Collective."""
        self.inner = PETSc.KSP().create(equations.prolongation.comm)
        self._equations, self._border = equations, Border(equations)

    def within(self, ksp: PETSc.KSP) -> PETSc.KSP:
        """Make a solver of SNES's solve by this; the one within, which is to be configured."""
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(self)
        return self.inner

    @property
    def operator(self) -> PETSc.Mat:
        """A matrix of the right size for SNES, without entries. Collective."""
        y = self._equations.unknowns()
        empty = PETSc.Mat().createAIJ([y.sizes] * 2, nnz=0, comm=y.comm)
        empty.assemble()
        y.destroy()
        return empty

    def renew(self, A: PETSc.Mat | None = None) -> None:
        """Follow a new tangent, or another matrix. Collective."""
        self.inner.setOperators(self._equations.tangent_matrix if A is None else A)
        self._border.renew(self.inner.solve, self.inner)

    def apply(self, pc: PETSc.PC | None, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call. Collective."""
        self._border.solve(self.inner.solve, r, z)

    def destroy(self, pc: PETSc.PC | None = None) -> None:
        """PETSc's call: free the inner solver. Collective."""
        free(self.inner, self._border)


@dataclass(frozen=True)
class Shared:
    """Ports that share solves."""

    right: Array  # sum of the ports of each solve, shape (solves, unknowns)
    # Numbers of unknowns and of solves, of all that a port has a part in, by unknowns
    places: tuple[Ints, Ints]
    pattern: tuple[Ints, Ints]  # the ports of these, and where each unknown begins among them
    count: int  # number of ports

    def responses(self, solve: Callable[[Array], Array], ksp: PETSc.KSP | None = None) -> csr_array:
        """A⁻¹ of single ports, shape (unknowns, ports), by solves that they share. Collective.

        Factors of one rank, if there are such, solve for all at once.
        """
        if ksp is not None and ksp.comm.size == 1 and len(self.right):
            found = _all_at_once(ksp, self.right)
        else:
            found = np.empty_like(self.right)
            for k in range(len(found)):
                found[k] = solve(self.right[k])
        unknown, number = self.places
        shape = self.right.shape[1], self.count
        return csr_array((found[number, unknown], *self.pattern), shape=shape)


def _all_at_once(ksp: PETSc.KSP, right: Array) -> Array:
    """A⁻¹ of the rows of a matrix: a sixth of the time of single solves with MUMPS."""
    B = PETSc.Mat().createDense(right.shape[::-1], array=right.T, comm=ksp.comm)
    X = B.duplicate()
    ksp.matSolve(B, X)
    found = np.array(X.getDenseArray().T)
    free(B, X)
    return found


def parted(A: PETSc.Mat, E: csr_array) -> Shared:
    """Ports that share solves with A; E has a row for each unknown of this rank. Collective."""
    part, comm = _parts(A, E), A.comm.tompi4py()
    unknowns, ports = E.tocoo().coords
    own: Ints = np.full(E.shape[1], -1, dtype=np.int64)
    own[ports] = part[unknowns]
    of_port = np.empty_like(own)
    comm.Allreduce(own, of_port, op=MPI.MAX)
    order = np.argsort(of_port, kind="stable")
    turn = np.empty_like(order)  # which of the ports of its part each is
    turn[order] = np.arange(order.size) - np.searchsorted(of_port[order], of_port[order])
    moved = np.flatnonzero(of_port >= 0)
    solves, parts = (int(x.max(initial=-1)) + 1 for x in (turn[moved], np.r_[part, of_port]))
    port_of = np.full((parts, solves), -1, dtype=np.int64)
    port_of[of_port[moved], turn[moved]] = moved
    owners = port_of[part]
    unknown, number = np.nonzero(owners >= 0)
    pattern = owners[unknown, number], np.searchsorted(unknown, np.arange(part.size + 1))
    right = np.zeros((solves, part.size))
    np.add.at(right, (turn[ports], unknowns), E.tocoo().data)
    return Shared(right, (unknown, number), pattern, E.shape[1])


def _parts(A: PETSc.Mat, E: csr_array) -> Ints:
    """The part of each of this rank's unknowns, numbered alike on all ranks. Collective.

    The unknowns of a port are in one part, whether entries of the matrix connect them or not.
    """
    comm = A.comm.tompi4py()
    n, count = E.shape[0], E.shape[1]
    rows = A.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()) if A.getBlockSize() > 1 else A
    offsets, columns, _ = rows.getValuesCSR()
    if rows is not A:
        rows.destroy()
    first, last = A.getOwnershipRange()
    pairs = np.repeat(np.arange(first, last), np.diff(offsets)), columns
    inside = (columns >= first) & (columns < last)
    unknowns, ports = E.tocoo().coords
    i, j = (own[inside] - first for own in pairs)
    edges = np.concatenate([i, unknowns]), np.concatenate([j, n + ports])
    graph = csr_array((np.ones(edges[0].size), edges), shape=(n + count,) * 2)
    labels, part = connected_components(graph, directed=False)
    part = part.astype(np.int64)
    if comm.size == 1:
        return part[:n]
    part += comm.exscan(labels) or 0
    every = np.concatenate(comm.allgather(part[:n]))
    across = np.unique(np.stack([every[own[~inside]] for own in pairs]), axis=1)
    of_ports = np.stack(comm.allgather(part[n:]))
    met = [across, np.stack([of_ports[0].repeat(comm.size), of_ports.T.ravel()])]
    links = np.concatenate(comm.allgather(np.concatenate(met, axis=1)), axis=1)
    shape = (comm.allreduce(labels),) * 2
    whole = csr_array((np.ones(links.shape[1]), (links[0], links[1])), shape=shape)
    _, joined = connected_components(whole, directed=False)
    return np.asarray(joined[part[:n]], dtype=np.int64)

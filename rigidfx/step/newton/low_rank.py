"""Follow the stiffness of contacts by a kept tangent: a correction of low rank.

A contact that opens or closes changes the tangent A by a matrix of low rank. With K the stiffness
of contacts at the last iterate, K₀ that in A, and Q the rotation of the unknowns since A was
assembled (`Frames`),

    A' = A + Δ,    Δ = Qᵀ K Q - K₀ ≈ B Bᵀ Δ,
    A'⁻¹ r = z - Y (I + W Y)⁻¹ W z,    z = A⁻¹ r,  Y = A⁻¹ B,  W = Bᵀ Δ

(M. A. Woodbury, Inverting modified matrices, Princeton 1950). B is an orthonormal basis of what
has changed since A was assembled: one column for each node that a plane without friction presses.
A column takes one solve. It serves as long as A does, however often the contact changes there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import csc_array, csr_array

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.contacts.surface import STALE
from rigidfx.mechanics.rotation import AXES

Solve = Callable[[PETSc.Vec, PETSc.Vec], None]


class LowRank:
    """The correction of one kept tangent; `destroy` frees its vectors.

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
        B = self._moved(rows)
        new = _basis(change, B, STALE * scale, most - self.columns)
        if new is None:
            return False
        self._now, self._rows, self._B = entries, rows, np.c_[B, new]
        self._extend(new, solve)
        self._take(change)
        return True

    def _moved(self, rows: Ints) -> Array:
        """B at unknowns that those at which it has entries are among."""
        B = np.zeros((rows.size, self.columns))
        B[np.searchsorted(rows, self._rows)] = self._B
        return B

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
        self._right.destroy()
        self._left.destroy()


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

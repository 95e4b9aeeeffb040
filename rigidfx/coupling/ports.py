"""Ports: where joints take hold of the unknowns of a step.

Averages over free nodes are three ports each; a body has six, and one for each of its shapes. Rows
that others imply, as of two hinges of one door, have no forces of their own. With D the derivatives
of rows by ports and the mass's compliance C = B Bᵀ, rows are independent as the columns of (D B)ᵀ
are: by a QR with pivots.
"""

import numpy as np
from mpi4py import MPI
from scipy.linalg import qr
from scipy.sparse import csr_array, hstack

from rigidfx.base.matrices import Matrix, Pattern, dense
from rigidfx.base.types import Array, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rotation import AXES

RANK = 1e-5  # of the largest pivot: what is less may be rounding of the solves for shapes


class Ports:
    """Where joints take hold of the unknowns; arrays are equal on all ranks but for `entries`.

    Attributes:
        averages: Averages that have free nodes; three ports each.
        bodies: Bodies that joints take hold of; their unknowns are ports.
        at: Port of each unknown of these, -1 where a body has none, shape (bodies, 6 + m).
        entries: Derivatives of the ports by this rank's unknowns, transposed, shape
            (unknowns, ports).
    """

    def __init__(self, p: Prolongation, linkage: Linkage) -> None:
        """Find them, of joints bound to the same division. Collective."""
        self._anchors: Ints = np.empty(0, np.int64)  # unknowns that are ports by themselves
        of, free = linkage.averages, p.free_of_nodes
        unknown = np.cumsum(free).reshape(free.shape) - 1
        found = [(AXES[:0], AXES[:0], np.empty(0))]
        for k in np.flatnonzero(linkage.used):
            weights = np.zeros((p.layout.rows.nodes.size, 1))
            weights[of.rows] = of.own[[k]].toarray().T
            w = p.at_nodes(weights)
            node, axis = np.nonzero(free & (w != 0.0))
            found.append((unknown[node, axis], 3 * k + axis, w[node, 0]))
        row, column, value = map(np.concatenate, zip(*found, strict=True))
        known = np.zeros(linkage.used.size, dtype=np.int32)
        known[column // 3] = 1
        p.comm.Allreduce(MPI.IN_PLACE, known, op=MPI.MAX)
        self.averages: Ints = np.flatnonzero(known)
        column = 3 * np.searchsorted(self.averages, column // 3) + column % 3
        of_nodes = csr_array((value, (row, column)), shape=(p.owned, 3 * len(self.averages)))
        n = p.increments.displacement.shape[1]
        held = np.asarray(abs(of.held[linkage.used]).sum(axis=0)).reshape(-1, n)
        self.bodies: Ints = np.flatnonzero(held.sum(axis=1))
        unknowns = p.body_columns[self.bodies]
        self._known = unknowns >= 0
        self._of_bodies = unknowns[self._known]
        column = self._of_bodies - p.first_column
        here = np.flatnonzero((column >= 0) & (column < p.owned))
        shape = p.owned, column.size
        of_bodies = csr_array((np.ones(here.size), (column[here], here)), shape=shape)
        self.entries = csr_array(hstack([of_nodes, of_bodies], format="csr"))
        self.at = np.full(unknowns.shape, -1)
        self.at[self._known] = 3 * len(self.averages) + np.arange(column.size)
        self._linkage, self._p = linkage, p
        used = of.held.tocoo()
        at = linkage.used[used.coords[0]]
        body, arm = np.divmod(used.coords[1][at], n)
        numbers = used.coords[0][at] * len(p.body_columns) + body
        pairs, which = np.unique(numbers, return_inverse=True)
        row, body = np.divmod(pairs, len(p.body_columns))  # averages and their bodies
        counts, body = np.bincount(body)[self.bodies], np.searchsorted(self.bodies, body).ravel()
        place = np.empty(pairs.size, dtype=np.int64)  # of a pair among those of its body
        place[np.argsort(body, kind="stable")] = np.concatenate([AXES[:0], *map(np.arange, counts)])
        self._pairs = body, place
        self._held = np.zeros((len(self.bodies), counts.max(initial=0), n))
        np.add.at(self._held, (body[which], place[which], arm), used.data[at])
        self._free: Matrix | None = None
        rows = (3 * self.averages[:, None] + np.arange(3)).ravel()
        column = self.at[body][:, None]
        row, column = np.broadcast_arrays(3 * row[:, None, None] + np.arange(3)[:, None], column)
        self._there = column >= 0
        row, column = row[self._there], column[self._there]
        self._places = np.r_[rows, row], np.r_[np.arange(rows.size), column]
        self._pattern = Pattern(*self._places, (3 * linkage.used.size, self.count))

    def resisted(self, linkage: Linkage, bodies: Bodies) -> tuple[Array, Array, Array]:
        """Knowledge of independent rows, at the start of a step. Collective.

        That are derivatives of rows by ports, and the sums of the absolute values of their terms,
        shape (rows, ports); and velocities of ports per impulse at them, as far as the masses of
        nodes and bodies are concerned.
        """
        p = self._p
        p.pose(bodies)
        mass, none = p.unknowns(), p.no_bodies
        p.collapse(np.repeat(np.abs(p.layout.masses), 3), none, mass)
        own = mass.array_r.copy()
        mass.destroy()
        inverse = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0)
        compliance = (self.entries.T * inverse[None]) @ self.entries
        every = p.sum(compliance.toarray())
        blocks = bodies.mass_blocks
        for body, at, known in zip(self.bodies, self.at, self._known, strict=True):
            block = blocks[body][np.ix_(known, known)]
            if bodies.of.records[body].extent is not None:  # no mass of its own: that of its joints
                block = linkage.masses.max(initial=1.0) * np.eye(len(block))
            every[np.ix_(at[known], at[known])] = np.linalg.inv(block)
        return *self.led(linkage.gradient(0.0)), every

    def led(self, rows: Matrix) -> tuple[Array, Array]:
        """Derivatives of rows by ports, and the sums of the absolute values of their terms.

        Derivatives by averages have the shape (rows, 3 · averages).
        """
        lead = self.lead(self._p.increments)
        return dense(rows @ lead), dense(abs(rows) @ abs(lead))

    def everywhere(self) -> csr_array:
        """Derivatives of the ports by the unknowns of all ranks, (ports, unknowns). Collective."""
        own = self.entries.tocoo()
        first = self._p.first_column
        mine = own.data, own.coords[1], own.coords[0] + first
        values, ports, unknowns = (
            np.concatenate(a) for a in zip(*self._p.comm.allgather(mine), strict=True)
        )
        return csr_array((values, (ports, unknowns)), shape=(self.count, self._p.size))

    def anchor(self) -> None:
        """Add ports at three nodes of each place that free nodes tell. Collective.

        With springs on these, and on the bodies' ports, no part that joints take hold of is loose.
        """
        p, linkage = self._p, self._linkage
        numbers = p.numbers.reshape(-1, 3)[linkage.averages.rows]
        found: set[tuple[int, ...]] = set()
        for k in self.averages:
            if not linkage.averages.is_place[k]:
                continue
            own = (linkage.averages.own[[k]].toarray()[0] != 0.0) & (numbers >= 0).all(axis=1)
            mine = p.layout.rows.X[linkage.averages.rows[own]], numbers[own]
            X, unknowns = (np.concatenate(a) for a in zip(*p.comm.allgather(mine), strict=True))
            found |= {tuple(map(int, unknowns[n])) for n in far_apart(X)}
        at = np.array(sorted(found), dtype=np.int64).ravel()
        here = (at >= p.first_column) & (at < p.first_column + p.owned)
        rows, columns = at[here] - p.first_column, np.flatnonzero(here)
        more = csr_array((np.ones(rows.size), (rows, columns)), shape=(p.owned, at.size))
        self.entries = csr_array(hstack([self.entries, more], format="csr"))
        self._anchors, self._free = at, None
        self._pattern = Pattern(*self._places, (3 * linkage.used.size, self.count))

    def anchors(self) -> tuple[Ints, Ints]:
        """Ports that springs may be on, those of bodies and anchors, and their unknowns."""
        ports = np.arange(3 * len(self.averages), self.count)
        return ports, np.r_[self._of_bodies, self._anchors]

    @property
    def vectors(self) -> Ints:
        """First port of each vector of three, which turns with its node or body."""
        frames = self.at[self._known[:, 0], :6:3].ravel()
        first = 3 * len(self.averages) + self._of_bodies.size
        return np.r_[3 * np.arange(len(self.averages)), frames, np.arange(first, self.count, 3)]

    @property
    def count(self) -> int:
        """Number of ports."""
        return 3 * len(self.averages) + self._of_bodies.size + self._anchors.size

    def lead(self, increments: Increments, end: bool = False) -> Matrix:
        """How averages follow ports in a step, or at its end, shape (3 · averages, ports)."""
        if self._free is not None:
            return self._free
        values = increments.led(self._held, self.bodies, end)[self._pairs]
        every = np.concatenate([np.ones(3 * self.averages.size), values[self._there]])
        out = self._pattern.filled(every)
        if not self.bodies.size:  # then it is always the same
            self._free = out
        return out


def far_apart(X: Array) -> list[int]:
    """Three of some points that are far apart; fewer where there are fewer."""
    if not len(X):
        return []
    first = int(np.argmax(np.linalg.norm(X - X.mean(axis=0), axis=1)))
    second = int(np.argmax(np.linalg.norm(X - X[first], axis=1)))
    line = X[second] - X[first]
    third = int(np.argmax(np.linalg.norm(np.cross(X - X[first], line), axis=1)))
    return sorted({first, second, third})


def independent(D: Array, terms: Array, compliance: Array) -> Ints:
    """Numbers of rows that imply all others, sorted.

    D are derivatives of rows by ports, and terms sums of the absolute values of their terms, shape
    (rows, ports); the compliance has velocities of ports per impulse at them [1/kg].
    """
    if not D.size:
        return np.arange(0)
    own = np.sqrt(np.diagonal(compliance))
    own = np.where(own > 0, own, 1.0)
    values, vectors = np.linalg.eigh(compliance / np.outer(own, own))
    # A root would make 1e-8 of rounding in directions that ports do not have: more than RANK.
    seen = values > own.size * np.finfo(np.float64).eps * values[-1]
    root = own[:, None] * vectors[:, seen] * np.sqrt(values[seen])
    columns = (D @ root).T
    sizes = np.linalg.norm(columns, axis=0)
    # Of a row with both sides in one body, or on nodes that supports move, only rounding is left.
    moves = sizes > RANK * np.linalg.norm(terms * own, axis=1).max()
    columns = np.where(moves, columns, 0.0) / np.where(moves, sizes, 1.0)
    R, order = qr(columns, mode="r", pivoting=True)
    pivots = np.abs(np.diagonal(R))
    rank = int(np.count_nonzero(pivots > RANK * pivots.max(initial=0.0)))
    return np.sort(order[:rank]).astype(np.int64)

"""Unknowns that follow cells which are dealt out anew, and how numbers at rows get there and back.

Rows stay with the ranks that own their nodes in the mesh of the scene. Unknowns of free dofs go
where the copies of the flexible cells are: assembly and linear systems, which are nearly all of a
step, are divided as these.
"""

import numpy as np
from dolfinx import la

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.flexible.dealt_cells import NOWHERE, DealtCells, Exchange

# A step of an L all of whose flexible cells were one rank's of two took .62, .75 and .74 of the
# time with these dealt at 20 600, 8700 and 3000 unknowns: 3200, 1300 and 430 cells for each rank.
LOPSIDED = 1.4  # times the mean of all ranks that one of them has
FEW = 300  # cells of a rank in the mean


class DealtRows:
    """The rows of a layout, and their copies at the nodes of cells that are dealt.

    Attributes:
        cells: The cells.
        nodes: This rank's own nodes of these that have unknowns.
        free: Which of the three dofs of each of them are unknowns, shape (nodes, 3).
    """

    def __init__(self, layout: DofLayout, cells: DealtCells) -> None:
        """Find the ways of cells that residuals and tangents of a layout are over. Collective."""
        self.cells, rows = cells, layout.rows
        known = la.vector(layout.space.dofmap.index_map, 5)
        of_nodes = known.array.reshape(-1, 5)  # rank, place among its rows, whether free
        of_nodes[:, 0] = NOWHERE
        of_nodes[rows.nodes, 0] = rows.comm.rank
        of_nodes[rows.nodes, 1] = np.arange(rows.nodes.size)
        of_nodes[rows.nodes, 2:] = layout.free[rows.dofs].reshape(-1, 3)
        known.scatter_forward()
        rank, place, *free = cells.at_nodes(of_nodes).T
        self._count, active = rank.size, np.flatnonzero(rank >= 0)
        self._active = slice(None) if active.size == rank.size else active
        self._all = Exchange(rows.comm, rows.nodes.size, rank[active], place[active])
        n = cells.space.dofmap.index_map.size_local
        own = np.stack(free, axis=1)[:n] > 0
        self.nodes = np.flatnonzero(own.any(axis=1))
        self.free = own[self.nodes]
        self._own = Exchange(rows.comm, rows.nodes.size, rank[self.nodes], place[self.nodes])

    def give(self, values: Array) -> Array:
        """Values of rows' nodes, at their own copies: shape (rows' nodes, k) to (nodes, k)."""
        return self._own.give(values)

    def take(self, values: Array) -> Array:
        """The way back: shape (nodes, k) to (rows' nodes, k), zero at nodes without unknowns."""
        return self._own.collect(values)

    def give_nodes(self, values: Array, otherwise: float = 0.0) -> Array:
        """Values of rows' nodes, (nodes, k), at all local nodes of the cells' mesh. Collective.

        Nodes that are no row's, those of rigid cells alone, have other values.
        """
        out = np.full((self._count, values.shape[1]), otherwise)
        out[self._active] = self._all.give(values)
        return out

    def add_up(self, values: Array) -> Array:
        """Sums of values of all local nodes of the cells' meshes, at rows' nodes. Collective."""
        return self._all.collect(values[self._active])

    def destroy(self) -> None:
        """Free the ways. Collective."""
        self._all.destroy()
        self._own.destroy()


class Dealing:
    """Deals flexible cells out where that pays; `destroy` frees the dealt ones.

    Copies of cells are kept as bodies come and go: for as long as they hold flexible parts, and no
    rank has too much of it, a new division chooses among them. To deal out 6300 cells anew takes
    two ranks as long as four steps gain.
    """

    def __init__(self) -> None:
        self._cells: DealtCells | None = None

    def rows(self, layout: DofLayout, loaded: Indices) -> DealtRows | None:
        """The rows of a layout with its flexible cells dealt out, where that pays. Collective.

        Further owned cells that residuals are over are loaded. Rows are of no use any more when the
        next ones are asked for.
        """
        comm, none = layout.rows.comm, np.empty(0, dtype=np.int32)
        flexible = np.sort(np.concatenate([none, *layout.flexible.values()]))
        counts = np.array(comm.allgather(flexible.size))
        if not _lopsided(counts) or counts.mean() < FEW:
            return None
        cells = np.union1d(flexible, loaded)
        if self._cells is not None and self._serves(self._cells, cells, flexible):
            self._cells.forget()
        else:
            self.destroy()
            self._cells = DealtCells(layout.space, cells)
        return DealtRows(layout, self._cells)

    @staticmethod
    def _serves(dealt: DealtCells, cells: Indices, flexible: Indices) -> bool:
        """Whether the dealt part holds cells, and the flexible ones divided. Collective."""
        return dealt.hold(cells) and not _lopsided(dealt.counts(flexible))

    def destroy(self) -> None:
        """Free the dealt parts. Collective."""
        if self._cells is not None:
            self._cells.destroy()
            self._cells = None


def _lopsided(counts: Ints) -> bool:
    """Whether one of the ranks has too many of the cells."""
    return bool(counts.max() > LOPSIDED * counts.mean())

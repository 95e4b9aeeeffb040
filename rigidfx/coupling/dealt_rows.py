"""Unknowns that follow cells which are dealt out anew, and how numbers at rows get there and back.

Rows stay with the ranks that own their nodes in the mesh of the scene. Unknowns of free dofs go
where the copies of the flexible cells are: assembly and linear systems, which are nearly all of a
step, are divided as these.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import la

from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.domain.exchange import Exchange
from rigidfx.flexible.dealt_cells import DealtCells

__all__ = ["DealtRows", "dealt_rows"]

Array = npt.NDArray[np.float64]

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
        """Find the ways. Collective.

        Args:
            layout: Division of the dofs.
            cells: All cells that residuals and tangents of this layout are over.
        """
        self.cells, rows = cells, layout.rows
        known = la.vector(layout.space.dofmap.index_map, 5)
        of_nodes = known.array.reshape(-1, 5)  # rank, place among its rows, whether free
        of_nodes[rows.nodes, 0] = rows.comm.rank
        of_nodes[rows.nodes, 1] = np.arange(rows.nodes.size)
        of_nodes[rows.nodes, 2:] = layout.free[rows.dofs].reshape(-1, 3)
        known.scatter_forward()
        rank, place, *free = cells.at_nodes(of_nodes).T
        self._all = Exchange(rows.comm, rows.nodes.size, rank, place)
        n = cells.space.dofmap.index_map.size_local
        own = np.stack(free, axis=1)[:n] > 0
        self.nodes = np.flatnonzero(own.any(axis=1))
        self.free = own[self.nodes]
        self._own = Exchange(rows.comm, rows.nodes.size, rank[self.nodes], place[self.nodes])

    def give(self, values: Array) -> Array:
        """What rows' nodes have, at their own copies: shape (rows' nodes, k) to (nodes, k)."""
        return self._own.give(values)

    def take(self, values: Array) -> Array:
        """The way back: shape (nodes, k) to (rows' nodes, k), zero at nodes without unknowns."""
        return self._own.collect(values)

    def give_nodes(self, values: Array) -> Array:
        """What rows' nodes have, at all local nodes of the cells' mesh. Collective."""
        return self._all.give(values)

    def add_up(self, values: Array) -> Array:
        """Sums of what all local nodes of the cells' meshes have, at rows' nodes. Collective."""
        return self._all.collect(values)

    def destroy(self) -> None:
        """Free the ways. Collective."""
        self._all.destroy()
        self._own.destroy()
        self.cells.destroy()


def dealt_rows(layout: DofLayout, loaded: npt.NDArray[np.int32]) -> DealtRows | None:
    """The rows of a layout with its flexible cells dealt out, where that pays. Collective.

    Args:
        layout: Division of the dofs.
        loaded: Further owned cells that residuals are over, sorted.
    """
    comm = layout.rows.comm
    counts = np.array(comm.allgather(sum(own.size for own in layout.flexible.values())))
    if counts.max() <= LOPSIDED * counts.mean() or counts.mean() < FEW:
        return None
    cells = np.unique(np.concatenate([loaded, *layout.flexible.values()]))
    return DealtRows(layout, DealtCells(layout.space, cells))

"""Numbers at nodes that cells of all ranks round them have, or the rank that owns them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from petsc4py import PETSc

from rigidfx.base.types import Array, Indices
from rigidfx.scene.scene import Scene


class AtNodes:
    """Passes numbers at nodes between ranks."""

    def __init__(self, scene: Scene) -> None:
        """Make a field for them. Collective."""
        self._x = fem.Function(scene.space).x
        self._owned = scene.owned_nodes

    def largest(self, nodes: Indices, values: Array) -> Array:
        """At each local node the largest value of cells, of any rank, round it. Collective.

        Args:
            nodes: Local nodes of owned cells, shape (cells, nodes of a cell).
            values: Of these cells.

        Returns:
            Minus infinity where there is none.
        """
        x = self._x
        x.array[:] = -np.inf
        np.maximum.at(x.array, 3 * nodes.reshape(-1), np.repeat(values, nodes.shape[1]))
        x.petsc_vec.ghostUpdate(addv=PETSc.InsertMode.MAX, mode=PETSc.ScatterMode.REVERSE)
        x.scatter_forward()
        return x.array[::3].copy()

    def of_owners(self, values: npt.NDArray[np.generic]) -> Array:
        """Numbers of owned nodes, as numbers of all local nodes. Collective."""
        x = self._x
        x.array[::3][: self._owned] = values
        x.scatter_forward()
        return x.array[::3].copy()

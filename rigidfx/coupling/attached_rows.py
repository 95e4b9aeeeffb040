"""Rows of nodes that bodies hold: how a body's numbers move them, and their sums.

The body-fixed coordinates a = [1, V, Φ₁, ..., Φ_m] of a body's nodes never change; each node moves
by them times a matrix of n = 4 + 3 m rows, see `Increments`, which is all that turns. So the
increments of these rows are

    d = N [3 n numbers of each body],    N constant and sparse,

and moments of forces at them come by Nᵀ. PETSc multiplies, by vectors whose numbers are NumPy's: a
product of SciPy's takes three times as long where bodies are small.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.types import Array, Ints
from rigidfx.coupling.dof_layout import DofLayout

__all__ = ["AttachedRows"]

Int = PETSc.IntType


class AttachedRows:
    """The rows of this rank that bodies of a layout hold.

    Attributes:
        rows: These rows, sorted.
        displacement: Displacement at the freeze, in their order [m].
        entries: N, with a row for each row of the layout, shape (rows, 3 n · bodies) [1, m].
    """

    def __init__(self, layout: DofLayout) -> None:
        """Find them.

        Args:
            layout: Division of the dofs.
        """
        rows, self._shape = layout.rows, layout.ensemble.frozen.shape
        height, count = 3 * self._shape[1], layout.ensemble.frozen.size
        parts: list[tuple[Ints, Ints, Array]] = []  # rows, columns, values
        displacement = np.zeros(rows.dofs.size)
        for k, (body, at) in enumerate(zip(layout.bodies, layout.attached, strict=True)):
            coordinates = body.coordinates(at)
            shape = at.size, 3, coordinates.shape[1]
            node, axis, j = (i.reshape(-1) for i in np.indices(shape))
            places = 3 * rows.positions(body.nodes[at])[node] + axis
            displacement[places] = body.displacement[at][node, axis]
            parts.append((places, height * k + 3 * j + axis, coordinates[node, j]))
        none = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
        row, column, value = map(np.concatenate, zip(none, *parts, strict=True))
        self.entries = csr_array((value, (row, column)), shape=(rows.dofs.size, count))
        self.rows: Ints = np.unique(row)
        self.displacement: Array = displacement[self.rows]
        own = self.entries[self.rows]
        self._numbers, self._at_rows = np.zeros(count), np.zeros(self.rows.size)
        vectors = (self._numbers, self._at_rows)
        self._of_bodies, self._of_rows = (
            PETSc.Vec().createWithArray(values, comm=PETSc.COMM_SELF) for values in vectors
        )
        csr = own.indptr.astype(Int), own.indices.astype(Int), own.data
        self._N = PETSc.Mat().createAIJ(own.shape, csr=csr, comm=PETSc.COMM_SELF)

    def __len__(self) -> int:
        """How many there are."""
        return self._at_rows.size

    def moved(self, numbers: Array) -> Array:
        """Their values, in their order; to be used before the next call.

        Args:
            numbers: Those of each body, shape (bodies, n, 3), or as many.
        """
        self._numbers[:] = numbers.reshape(-1)
        self._N.mult(self._of_bodies, self._of_rows)
        return self._at_rows

    def moments(self, f: Array) -> Array:
        """Sums over them, shape (bodies, n, 3).

        Args:
            f: One number per row of the layout.
        """
        self._at_rows[:] = f[self.rows]
        self._N.multTranspose(self._of_rows, self._of_bodies)
        return self._numbers.reshape(self._shape).copy()

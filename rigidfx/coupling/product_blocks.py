"""From the product Aᵀ K A of an interface to the reduced matrix.

The product has rows and columns of nodes, three each, and of bodies, 3 n = 12 + 9 m each. Those of
nodes are unknowns; those of bodies become their 6 + m unknowns by two matrices for each body, shape
(3 n, 6 + m), L on the left, P on the right. So there are blocks of three kinds, a node's rows in a
body's columns, a body's in a node's and a body's in a body's. Each kind is gathered by index and
multiplied at once, however many bodies there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.sparse import bsr_array, csr_array

from rigidfx.base.types import Array, Ints

__all__ = ["BlockPlaces", "ProductBlocks"]

Int = PETSc.IntType


@dataclass(frozen=True)
class Kind:
    """The blocks of one kind.

    Attributes:
        left: Whether rows are of bodies.
        right: Whether columns are.
        row: Node or body of each block's rows.
        column: Node or body of its columns.
        places: Where the values of each are in the product's, shape (blocks, 3 or 3 n, 3 or 3 n).
    """

    left: bool
    right: bool
    row: Ints
    column: Ints
    places: Ints

    def condensed(self, values: Array, LT: Array, P: Array) -> Array:
        """The blocks in unknowns, cut into 3×3 blocks, one after the other.

        Args:
            values: Those of the product.
            LT: Shape (bodies, 3 k, 3 n), 3 k being 6 + m and what is missing to threes.
            P: Shape (bodies, 3 n, 3 k).
        """
        K = values[self.places]
        if self.right:
            K = K @ P[self.column]
        if self.left:
            K = LT[self.row] @ K
        n, rows, columns = K.shape
        return K.reshape(n, rows // 3, 3, columns // 3, 3).swapaxes(2, 3).reshape(-1)


class BlockPlaces:
    """Where 3×3 blocks go in a reduced matrix."""

    def __init__(self, row: Ints, column: Ints, nodal: bool) -> None:
        """Prepare the arguments of PETSc.

        Args:
            row: Unknowns of the rows of each block, shape (blocks, 3); values of those below zero
                are dropped.
            column: Those of its columns.
            nodal: Whether free dofs come in whole nodes, so that the reduced matrix has blocks.
        """
        self._nodal = nodal
        if nodal:
            row, column = row[:, 0] // 3, column[:, 0] // 3
        else:
            row = np.repeat(row.reshape(-1), 3)
            column = np.repeat(column, 3, axis=0).reshape(-1)
        starts = np.flatnonzero(np.diff(row, prepend=-2))  # a row is told once in a run
        self._rows = row[starts].astype(Int)
        self._offsets = np.r_[starts, row.size].astype(Int)
        self._columns = column.astype(Int)

    def add(self, matrix: PETSc.Mat, values: Array) -> None:
        """Add the blocks' values, nine each, to a matrix, which is to be assembled then."""
        add = matrix.setValuesBlockedIJV if self._nodal else matrix.setValuesIJV
        add(self._offsets, self._columns, values, PETSc.InsertMode.ADD_VALUES, self._rows)


class ProductBlocks:
    """Where the values of a product go."""

    def __init__(
        self, C: PETSc.Mat, of_nodes: Ints, of_bodies: Ints, height: int, nodal: bool
    ) -> None:
        """Sort the blocks of the product.

        Args:
            C: The product: its rows and columns are of the nodes, then of the bodies.
            of_nodes: Unknown of each of a node's dofs, -1 if it is none, shape (nodes, 3).
            of_bodies: The unknowns of each body, -1 where it has fewer, shape (bodies, 6 + m).
            height: n.
            nodal: As `BlockPlaces` takes it.
        """
        indptr, columns, values = C.getValuesCSR()
        places = csr_array((np.arange(values.size), columns, indptr), shape=C.size)
        pattern = places.tobsr((3, 3))
        sides = (False, True), (True, False), (True, True)
        self._kinds = [_kind(pattern, len(of_nodes), height, *side) for side in sides]
        self._missing = -of_bodies.shape[1] % 3
        whole = np.pad(of_bodies, ((0, 0), (0, self._missing)), constant_values=-1)
        unknowns = of_nodes[:, None], whole.reshape(len(whole), whole.shape[1] // 3, 3)
        numbers = zip(*(_unknowns(kind, unknowns) for kind in self._kinds), strict=True)
        row, column = (np.concatenate([n.reshape(-1, 3) for n in side]) for side in numbers)
        self._places = BlockPlaces(row, column, nodal)

    def insert_into(self, matrix: PETSc.Mat, C: PETSc.Mat, L: Array, P: Array) -> None:
        """Add diag(1, L)ᵀ C diag(1, P) to a reduced matrix, which is to be assembled then.

        Args:
            matrix: The reduced matrix.
            C: The product.
            L: Shape (bodies, 3 n, 6 + m).
            P: Likewise.
        """
        if self._missing:
            L, P = (np.pad(side, ((0, 0), (0, 0), (0, self._missing))) for side in (L, P))
        values, LT = C.getValuesCSR()[2], L.swapaxes(1, 2)
        blocks = [kind.condensed(values, LT, P) for kind in self._kinds]
        self._places.add(matrix, np.concatenate(blocks))


def _kind(pattern: bsr_array, nodes: int, n: int, left: bool, right: bool) -> Kind:
    """Join 3×3 blocks to those of one kind; the first rows and columns are of so many nodes."""
    row = np.repeat(np.arange(pattern.indptr.size - 1), np.diff(pattern.indptr))
    column = pattern.indices.astype(np.int64)
    mine = np.flatnonzero(((row >= nodes) == left) & ((column >= nodes) == right))
    height, width = n if left else 1, n if right else 1
    row, i = np.divmod(row[mine] - nodes * left, height)
    column, j = np.divmod(column[mine] - nodes * right, width)
    order = np.lexsort((j, i, column, row))
    places = pattern.data[mine[order]].reshape(-1, height, width, 3, 3).swapaxes(2, 3)
    first = order[:: height * width]
    shape = -1, 3 * height, 3 * width
    return Kind(left, right, row[first], column[first], places.reshape(shape))


def _unknowns(kind: Kind, unknowns: tuple[Ints, Ints]) -> tuple[Ints, ...]:
    """Unknowns of the rows and of the columns of each 3×3 block that `condensed` gives.

    Args:
        kind: The blocks.
        unknowns: Those of nodes, shape (nodes, 1, 3), and of bodies, shape (bodies, k, 3).
    """
    row, column = unknowns[kind.left][kind.row], unknowns[kind.right][kind.column]
    return tuple(np.broadcast_arrays(row[:, :, None], column[:, None]))

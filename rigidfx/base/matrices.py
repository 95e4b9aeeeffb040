"""Matrices that are arrays where they are small: a call of SciPy's sparse ones costs 10 to 100 µs.

So are those that have few zeros: BLAS takes a tenth of a sparse product's time for each entry.

Sums and products of both kinds are written alike; what is to be of one kind passes `dense`, or
`csr_array`.
"""

from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array, sparray, vstack

from rigidfx.base.types import Array, Ints

Matrix: TypeAlias = Array | csr_array

# Entries of a small matrix. Steps of chains of 2, 4, 6, 8, 10 and 14 four-bar linkages took .61,
# .66, .80, 1.0, 1.05 and 1.02 of the time without arrays.
SMALL = 30_000


def is_small(rows: int, columns: int) -> bool:
    """Whether a matrix is to be an array."""
    return rows * columns <= SMALL


def compact(matrix: csr_array) -> Matrix:
    """The matrix as an array if it is small or has places for half of its entries."""
    small = is_small(*matrix.shape) or 2 * matrix.nnz >= matrix.shape[0] * matrix.shape[1]
    return matrix.toarray() if small else matrix


def dense(matrix: Array | sparray) -> Array:
    """The matrix as an array."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.toarray())


def stacked(upper: Matrix, lower: Matrix) -> Matrix:
    """Rows of both, an array if both are."""
    if isinstance(upper, np.ndarray) and isinstance(lower, np.ndarray):
        return np.concatenate([upper, lower])
    return csr_array(vstack([upper, lower], format="csr"))


class Pattern:
    """Places in a matrix, which is filled again and again."""

    def __init__(self, rows: Ints, columns: Ints, shape: tuple[int, int]) -> None:
        """Keep the places, some of them more than once, shape (places,) each."""
        self._places, self._shape = rows * shape[1] + columns, shape
        self._small = is_small(*shape)

    @cached_property
    def _compressed(self) -> tuple[Ints, Ints, Ints]:
        """Which entry each place is; columns of entries, and where rows begin among them."""
        rows, columns = self._shape
        entries, which = np.unique(self._places, return_inverse=True)
        ends = np.searchsorted(entries, columns * np.arange(rows + 1))
        return which, entries % max(columns, 1), ends

    def filled(self, values: Array) -> Matrix:
        """The matrix of values at the places, added up; an array if it is small."""
        if not self._small:
            return self.sparse(values)
        sums = np.bincount(self._places, values, self._shape[0] * self._shape[1])
        return sums.astype(np.float64, copy=False).reshape(self._shape)

    def sparse(self, values: Array) -> csr_array:
        """The same, sparse: better where few places are in a product."""
        which, columns, ends = self._compressed
        sums = np.bincount(which, values, columns.size)
        return csr_array((sums, columns, ends), shape=self._shape)


def distributed(rows: csr_array, sizes: object, comm: object) -> PETSc.Mat:
    """A matrix of PETSc's by this rank's rows, sorted; the caller destroys it. Collective."""
    kind = PETSc.IntType
    csr = rows.indptr.astype(kind), rows.indices.astype(kind), rows.data
    return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)


def free(*items: Any) -> None:
    """Destroy objects of PETSc's, or with such, those of them that there are. Collective."""
    for item in items:
        if item is not None:
            item.destroy()

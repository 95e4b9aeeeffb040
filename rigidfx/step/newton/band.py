"""How many entries the factors of a matrix will have, before anything is factored.

With the rows of a sparse matrix in the order of Cuthill and McKee, reversed (A. George and J. W. H.
Liu, Computer Solution of Large Sparse Positive Definite Systems, Prentice-Hall 1981), factors have
entries only between the first entry of a row and the diagonal. These are few in small structures,
and in long and thin ones of any size.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

__all__ = ["fill"]


def fill(A: PETSc.Mat) -> float:
    """Entries of factors relative to the matrix' own, at most; infinite on several ranks.

    Args:
        A: A matrix whose pattern of entries is symmetric, and complete. Rows alike count as one.
    """
    if A.comm.size > 1:
        return np.inf
    start, column = A.getRowIJ(compressed=True)
    rows = len(start) - 1
    if not rows or not np.diff(start).all():
        return np.inf
    pattern = csr_array((np.ones(len(column), np.int8), column, start), shape=(rows, rows))
    place = np.empty(rows, dtype=np.int64)
    place[reverse_cuthill_mckee(pattern, symmetric_mode=True)] = np.arange(rows)
    first = np.minimum.reduceat(place[column], start[:-1])
    return float((2 * (place - first).sum() + rows) / len(column))

"""Whether the factors of a matrix will have few entries, before anything is factored.

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

__all__ = ["few_entries", "fill"]

# A solve with factors of few entries takes less than the handful of iterations by GMRES and leaves
# less. By kept factors instead of incomplete ones steps of soft parts took .36 to .79 of the time
# at a fill of 1.3 to 6.5, in bars, plates and blocks of 670 to 10 000 unknowns; 1.05 at 6.8 (an L
# of 3969 unknowns), .73 at 9.5 (a plate of 5625), .88 at 9.8 (a block of 2187).
FEW = 6.5
UP_TO = 30_000  # unknowns; .25 and .51 from 17 000 on, with PETSc's factors, not tried with MUMPS's


def few_entries(A: PETSc.Mat) -> bool:
    """Whether the factors of a matrix have few entries, as far as that is known.

    Args:
        A: A matrix whose pattern of entries is symmetric, and complete.
    """
    return A.comm.size == 1 and A.size[0] <= UP_TO and fill(A) <= FEW


def fill(A: PETSc.Mat) -> float:
    """Entries of the factors of a matrix over its own, at most; 1 where they are the same.

    Args:
        A: A matrix of one rank whose pattern of entries is symmetric. Rows alike count as one.
    """
    start, column = A.getRowIJ(compressed=True)
    rows = len(start) - 1
    if not rows or not np.diff(start).all():
        return np.inf
    pattern = csr_array((np.ones(len(column), np.int8), column, start), shape=(rows, rows))
    place = np.empty(rows, dtype=np.int64)
    place[reverse_cuthill_mckee(pattern, symmetric_mode=True)] = np.arange(rows)
    first = np.minimum.reduceat(place[column], start[:-1])
    return float((2 * (place - first).sum() + rows) / len(column))

"""How many entries factors will have is told by the pattern of a matrix."""

from __future__ import annotations

import numpy as np
import pytest
from petsc4py import PETSc
from scipy.sparse import csr_array, kron
from scipy.sparse.csgraph import reverse_cuthill_mckee

from rigidfx.step.newton import chord


def _line(n):
    """The pattern of a line of n nodes, each coupled with its neighbours."""
    dense = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= 1
    return csr_array(dense.astype(float))


def _matrix(pattern, order=None):
    pattern = csr_array(pattern)
    if order is not None:
        pattern = pattern[order][:, order]
    pattern.sort_indices()
    csr = pattern.indptr.astype(np.int32), pattern.indices.astype(np.int32), pattern.data
    return PETSc.Mat().createAIJ(pattern.shape, csr=csr, comm=PETSc.COMM_SELF)


def _grid(*cells):
    out = _line(cells[0])
    for n in cells[1:]:
        out = kron(out, _line(n))
    return out


@pytest.mark.parametrize("shuffled", [False, True])
def test_a_band_has_no_entries_but_its_own(shuffled):
    """Whatever the order of its rows is."""
    order = np.random.default_rng(0).permutation(40) if shuffled else None
    A = _matrix(_line(40), order)
    assert chord.fill(A) == pytest.approx(1.0)
    A.destroy()


def test_what_is_compact_fills_more_than_what_is_slender():
    found = []
    for cells in ((3, 3, 100), (10, 10, 10), (12, 12, 12)):
        A = _matrix(_grid(*cells))
        found.append(chord.fill(A))
        A.destroy()
    slender, compact, larger = found
    assert slender <= 2
    assert compact < larger


def test_no_factors_have_more():
    """Those in that order, by the rows that they fill in an elimination."""
    pattern = csr_array(_grid(4, 4, 6))
    A = _matrix(pattern)
    order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
    filled = pattern.toarray()[np.ix_(order, order)] != 0
    for k in range(len(filled)):
        below = np.flatnonzero(filled[k + 1 :, k]) + k + 1
        filled[np.ix_(below, below)] = True
    assert filled.sum() <= chord.fill(A) * pattern.nnz
    A.destroy()

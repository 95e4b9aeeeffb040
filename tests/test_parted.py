"""Ports of joints that share solves: each has the response that it has alone."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.step.newton.parted import parted


@pytest.mark.parametrize(("blocks", "solves"), [((3, 4, 2), 2), ((1,) * 9, 1)])
def test_ports_share_solves(blocks, solves):
    """The second matrix is diagonal, as lumped masses are: a port joins the parts it takes hold of.

    Ports 0 and 1 lie in the same part, 2 in another one, and nothing moves 3.
    """
    rng, n = np.random.default_rng(0), sum(blocks)
    dense, first = np.zeros((n, n)), 0
    for size in blocks:
        own = rng.normal(size=(size, size))
        dense[first : first + size, first : first + size] = own @ own.T + np.eye(size)
        first += size
    E = np.zeros((n, 4))
    E[[0, 2], 0], E[1, 1], E[[3, 5, 6], 2] = (1.0, -2.0), 1.0, (1.0, 2.0, 0.5)
    sparse = csr_array(dense)
    A = PETSc.Mat().createAIJ(
        (n, n), csr=(sparse.indptr, sparse.indices, sparse.data), comm=MPI.COMM_SELF
    )
    shared = parted(A, csr_array(E))
    found = shared.responses(lambda r: np.linalg.solve(dense, r))
    A.destroy()
    assert len(shared.right) == solves
    np.testing.assert_allclose(found.toarray(), np.linalg.solve(dense, E), atol=1e-14)

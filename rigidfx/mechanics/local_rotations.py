"""How the surroundings of each node have turned: the rotation that fits its cells best.

With X̄ and x̄ the means of a cell's nodes, the rotation R of node i is the polar factor of

    M = Σ_{cells at i} Σ_j (x_j - x̄)(X_j - X̄)ᵀ,

the warped stiffness of corotational methods (M. Müller et al., SCA 2002; F. Hecht et al., ACM TOG
31 (2012) 123). It maximizes tr(Rᵀ M). Newton's method from the last rotation, R ← R cay(δ) with
(tr B I - sym B) δ = axial(B - Bᵀ) and B = Rᵀ M, takes two or three iterations; where it finds none
the singular vectors of M tell.
"""

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.c_library import c_library
from rigidfx.base.types import Array, Indices
from rigidfx.mechanics.rotation import IDENTITY

SOURCE = Path(__file__).with_suffix(".c")
DECLARED = """
void spread(int, int, const int *, const double *, const double *, double *);
void fit(int, int, double, const double *, double *, char *);
void turn(int, const int *, int, const double *, double *);
"""
ITERATIONS, ENOUGH = 8, 1e-12  # of Newton's method; square of an angle whose own square is left
THIN = 1e-6  # a group of nodes this thin, relative to its length, has no direction of its own

_compiled: list[Any] = []  # the C code, once it is there


def _code(comm: MPI.Intracomm) -> Any:
    if not comm.allreduce(len(_compiled) > 0, op=MPI.LAND):
        _compiled[:] = [c_library(comm, "frames", SOURCE.read_text(), DECLARED, ["-O2", "-g0"])]
    return _compiled[0]


class LocalRotations:
    """The cells that some nodes have around them."""

    def __init__(self, cells: Indices, X: Array, comm: MPI.Intracomm) -> None:
        """Compile the C code if needed; cells by their nodes, X of all nodes [m]. Collective."""
        self._code = _code(comm)
        self._cells, self._X = np.ascontiguousarray(cells, dtype=np.int32), np.ascontiguousarray(X)

    def spread(self, u: Array, M: Array) -> None:
        """Add M of each node, shape (nodes, 9) [m²], of displacements of all dofs [m]."""
        of = self._code.ffi.from_buffer
        nodes, X = of("int *", self._cells), of("double *", self._X)
        u = np.ascontiguousarray(u)
        self._code.lib.spread(*self._cells.shape, nodes, X, of("double *", u), of("double *", M))

    def fit(self, M: Array, R: Array) -> None:
        """Find the rotations of M, shape (n, 9), in place of near ones, shape (n, 3, 3)."""
        of, found = self._code.ffi.from_buffer, np.zeros(len(M), dtype=np.int8)
        arrays = of("double *", M), of("double *", R), of("char *", found)
        self._code.lib.fit(len(M), ITERATIONS, ENOUGH, *arrays)
        lost = np.flatnonzero(found == 0)
        if lost.size:
            R[lost] = polar_factors(M[lost].reshape(-1, 3, 3))


def turn_vectors(y: Array, starts: Indices, Q: Array, transposed: bool) -> None:
    """Rotate vectors in `y`, which begin at `starts`, by Q or Qᵀ, shape (n, 3, 3), in place."""
    code = _compiled[0]
    of = code.ffi.from_buffer
    at, by = of("int *", starts), of("double *", Q)
    code.lib.turn(len(starts), at, int(transposed), by, of("double *", y))


def polar_factors(M: Array) -> Array:
    """The rotations nearest to matrices (n, 3, 3); none of one with less than two directions."""
    finite = np.isfinite(M).all(axis=(1, 2), keepdims=True)
    W, size, Vt = np.linalg.svd(np.where(finite, M, IDENTITY))
    W[:, :, 2] *= np.linalg.det(W @ Vt)[:, None]
    R = np.asarray(W @ Vt)
    R[size[:, 1] <= THIN**2 * size[:, 0]] = IDENTITY
    return R

"""The small system of joints, factored: displacements and forces of ports, and multipliers.

With C the compliance at the ports, H the curvature of the rows, D and D₁ their derivatives on the
test and on the trial side, and R the compliance of the rows,

    q + C f = q₀,    f = H q + Dᵀ μ,    D₁ q + R μ = s.

Small systems are arrays, without f; larger ones are sparse, with f, as C H is full.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from rigidfx.base.matrices import Matrix, dense, is_small
from rigidfx.base.types import Array

__all__ = ["Factors", "small_system"]

Factors = Callable[[Array, Array], tuple[Array, Array]]


def small_system(C: Matrix, H: Matrix, D: Matrix, D1: Matrix, R: Array) -> Factors | None:
    """A function that finds f and μ of q₀ and s; None where the system is singular.

    Args:
        C: Shape (ports, ports).
        H: Likewise.
        D: Shape (rows, ports).
        D1: Likewise.
        R: Shape (rows,).
    """
    size = sum(D.shape)
    if is_small(size, size):
        return _by_arrays(dense(C), dense(H), dense(D), dense(D1), R)
    return _sparse(C, H, D, D1, R)


def _by_arrays(C: Array, H: Array, D: Array, D1: Array, R: Array) -> Factors | None:
    rows, n = D.shape
    if not n + rows:  # supports hold all that joints and springs take hold of
        return lambda q, s: (q, s)
    matrix = np.empty((n + rows,) * 2, order="F")
    matrix[:n, :n] = C @ H
    matrix[np.arange(n), np.arange(n)] += 1.0
    matrix[:n, n:] = C @ D.T
    matrix[n:, :n] = D1
    matrix[n:, n:] = np.diag(R)
    LU, pivots, singular = dgetrf(matrix, overwrite_a=True)

    def solve(q: Array, s: Array) -> tuple[Array, Array]:
        found, _ = dgetrs(LU, pivots, np.concatenate([q, s]))
        return H @ found[:n] + D.T @ found[n:], found[n:]

    return None if singular > 0 else solve


def _sparse(C: Matrix, H: Matrix, D: Matrix, D1: Matrix, R: Array) -> Factors | None:
    rows, n = D.shape
    k, ones, at = np.arange(n), np.ones(n), np.arange(rows)
    C, H, D, D1 = map(coo_array, (C, H, D, D1))
    (hi, hj), (di, dj), (ei, ej), (ci, cj) = H.coords, D.coords, D1.coords, C.coords
    row = k, ci, n + hi, n + k, n + dj, 2 * n + ei, 2 * n + at
    column = k, n + cj, hj, n + k, 2 * n + di, ej, 2 * n + at
    values = ones, C.data, H.data, -ones, D.data, D1.data, R
    places = np.concatenate(row), np.concatenate(column)
    try:
        factors = splu(csc_array((np.concatenate(values), places), shape=(2 * n + rows,) * 2))
    except RuntimeError:  # SuperLU's word for a singular matrix
        return None

    def solve(q: Array, s: Array) -> tuple[Array, Array]:
        found = factors.solve(np.concatenate([q, np.zeros(n), s]))
        return found[n : 2 * n], found[2 * n :]

    return solve

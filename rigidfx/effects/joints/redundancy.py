"""Which rows of joints are independent: by a QR with pivots, in the metric of the mass.

Rows that others imply have no forces of their own: two hinges of one door, or all that holds a
plane mechanism in its plane more than once. With D the derivatives of rows by ports and the mass's
compliance C = B Bᵀ of the ports, rows are independent as the columns of (D B)ᵀ are.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from rigidfx.base.types import Array, Ints

__all__ = ["RANK", "independent"]


RANK = 1e-9  # of the largest pivot: what is less is rounding in places that joints hold to 1e-13 m


def independent(D: Array, terms: Array, compliance: Array) -> Ints:
    """Numbers of rows that imply all others, sorted.

    Args:
        D: Derivatives of rows by ports, shape (rows, ports).
        terms: Sums of the absolute values of the terms of these, likewise.
        compliance: Velocities of ports per impulse at them, shape (ports, ports) [1/kg].
    """
    if not D.size:
        return np.arange(0)
    own = np.sqrt(np.diagonal(compliance))
    own = np.where(own > 0, own, 1.0)
    values, vectors = np.linalg.eigh(compliance / np.outer(own, own))
    # A root would make 1e-8 of rounding in directions that ports do not have: more than RANK.
    seen = values > own.size * np.finfo(np.float64).eps * values[-1]
    root = own[:, None] * vectors[:, seen] * np.sqrt(values[seen])
    columns = (D @ root).T
    sizes = np.linalg.norm(columns, axis=0)
    # Of a row with both sides in one body, or on nodes that supports move, only rounding is left.
    moves = sizes > RANK * np.linalg.norm(terms * own, axis=1).max()
    columns = np.where(moves, columns, 0.0) / np.where(moves, sizes, 1.0)
    R, order = qr(columns, mode="r", pivoting=True)
    pivots = np.abs(np.diagonal(R))
    rank = int(np.count_nonzero(pivots > RANK * pivots.max(initial=0.0)))
    return np.sort(order[:rank]).astype(np.int64)

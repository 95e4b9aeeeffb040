"""The terms of all rows of joints: values, gradients and curvature."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.effects.joints.pieces import Row

__all__ = ["Terms"]

Array = npt.NDArray[np.float64]


class Terms:
    """g = Σ c p_i + Σ s p_k · p_l of many rows, at averages p of shape (averages, 3).

    Attributes:
        averages: Numbers of those that have a part in any row.
    """

    def __init__(self, rows: Sequence[Sequence[Row]], firsts: Sequence[int], averages: int) -> None:
        """Collect them.

        Args:
            rows: Rows of each joint.
            firsts: Number of each joint's first average.
            averages: Number of all averages.
        """
        every = [(row, first) for own, first in zip(rows, firsts, strict=False) for row in own]
        self._count = len(every)
        linear = [
            (r, 3 * (first + k) + axis, c)
            for r, (row, first) in enumerate(every)
            for k, axis, c in row.linear
        ]
        products = [
            (r, first + k, first + j, c)
            for r, (row, first) in enumerate(every)
            for k, j, c in row.products
        ]
        at = np.array([(r, c) for r, c, _ in linear], dtype=np.int64).reshape(-1, 2).T
        shape = self._count, 3 * averages
        self._linear = csr_array((np.array([v for *_, v in linear]), at), shape=shape)
        pairs = np.array([(r, k, j) for r, k, j, _ in products], dtype=np.int64).reshape(-1, 3)
        self._row, self._first, self._second = pairs.T
        self._factor = np.array([c for *_, c in products], dtype=np.float64)
        columns = 3 * pairs[:, 1:, None] + np.arange(3)
        self._sizes = abs(self._linear)
        self._columns, self._spread = columns.ravel(), csr_array(self._linear.T)
        of = np.broadcast_to(self._row[:, None, None], columns.shape).ravel()
        fixed = self._linear.tocoo()
        places = np.r_[fixed.coords[0], of], np.r_[fixed.coords[1], self._columns]
        self._fixed, self._gradient = fixed.data, Pattern(*places, shape)
        one, other = columns[:, 0].ravel(), columns[:, 1].ravel()
        self._curvature = Pattern(np.r_[one, other], np.r_[other, one], (shape[1],) * 2)
        self.averages = np.unique(np.r_[at[1] // 3, self._first, self._second])

    def _summed(self, products: Array) -> Array:
        """Σ s times each term's product, of each row."""
        sums = np.bincount(self._row, self._factor * products, self._count)
        return np.asarray(sums, dtype=np.float64)

    def value(self, p: Array) -> Array:
        """g, shape (rows,)."""
        products = (p[self._first] * p[self._second]).sum(axis=1)
        return np.asarray(self._linear @ p.ravel() + self._summed(products))

    def rounding(self, p: Array) -> Array:
        """Rounding of g at averages p, shape (rows,)."""
        size, factors = np.abs(p), np.abs(self._factor)
        products = factors * (size[self._first] * size[self._second]).sum(axis=1)
        sums = self._sizes @ size.ravel() + np.bincount(self._row, products, self._count)
        return np.asarray(4 * np.spacing(sums))

    def gained(self, middle: Array, d: Array) -> Array:
        """Exact gain of g where averages move by d, shape (rows,).

        Args:
            middle: Averages half-way.
            d: Their increments.
        """
        k, j = self._first, self._second
        terms = (middle[k] * d[j] + d[k] * middle[j]).sum(axis=1)
        return np.asarray(self._linear @ d.ravel() + self._summed(terms))

    def gradient(self, p: Array) -> Matrix:
        """∂g/∂p, shape (rows, 3 · averages)."""
        both = self._factor[:, None, None] * np.stack([p[self._second], p[self._first]], axis=1)
        return self._gradient.filled(np.concatenate([self._fixed, both.ravel()]))

    def forces(self, p: Array, multipliers: Array) -> Array:
        """Σ λ ∂g/∂p, shape (averages, 3).

        Args:
            p: The averages.
            multipliers: λ of each row.
        """
        out = np.asarray(self._spread @ multipliers)
        if self._row.size:
            share = (multipliers[self._row] * self._factor)[:, None, None]
            both = share * np.stack([p[self._second], p[self._first]], axis=1)
            out = out + np.bincount(self._columns, both.ravel(), out.size)
        return out.reshape(-1, 3)

    def curvature(self, multipliers: Array, share: float) -> csr_array:
        """Derivative of Σ λ ∂g/∂p after a part of a step by p at its end, (3 · averages,) * 2.

        Args:
            multipliers: λ of each row.
            share: That part: 0.5 for the middle of the step.
        """
        value = share * multipliers[self._row] * self._factor
        return self._curvature.sparse(np.tile(np.repeat(value, 3), 2))

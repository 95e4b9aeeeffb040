"""The terms of all rows of joints: values, gradients and curvature."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

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
        self._columns, self._spread = columns.ravel(), csr_array(self._linear.T)
        of = np.broadcast_to(self._row[:, None, None], columns.shape).ravel()
        # The pattern of gradients, and where in it each term's derivatives go.
        fixed = self._linear.tocoo()
        at_all = np.r_[fixed.coords[0], of], np.r_[fixed.coords[1], columns.ravel()]
        places, put = np.unique(at_all[0] * shape[1] + at_all[1], return_inverse=True)
        self._put, self._fixed = put[fixed.nnz :], np.zeros(places.size)
        np.add.at(self._fixed, put[: fixed.nnz], fixed.data)
        ends = np.searchsorted(places, shape[1] * np.arange(shape[0] + 1))
        self._pattern = places % shape[1], ends
        self.averages = np.unique(np.r_[at[1] // 3, self._first, self._second])

    def _products(self, p: Array, q: Array) -> Array:
        """Σ s p_k · q_l of each row."""
        values = self._factor * (p[self._first] * q[self._second]).sum(axis=1)
        return np.asarray(np.bincount(self._row, values, minlength=self._count), dtype=np.float64)

    def value(self, p: Array) -> Array:
        """g, shape (rows,)."""
        return np.asarray(self._linear @ p.ravel() + self._products(p, p))

    def rounding(self, p: Array) -> Array:
        """Rounding of g at averages p, shape (rows,)."""
        sizes = abs(self._linear) @ np.abs(p).ravel()
        products = np.abs(self._factor) * (np.abs(p[self._first]) * np.abs(p[self._second])).sum(1)
        return np.asarray(
            4 * np.spacing(sizes + np.bincount(self._row, products, minlength=self._count))
        )

    def gained(self, middle: Array, d: Array) -> Array:
        """Exact gain of g where averages move by d, shape (rows,).

        Args:
            middle: Averages half-way.
            d: Their increments.
        """
        products = self._products(middle, d) + self._products(d, middle)
        return np.asarray(self._linear @ d.ravel() + products)

    def gradient(self, p: Array) -> csr_array:
        """∂g/∂p, shape (rows, 3 · averages)."""
        if not self._row.size:
            return self._linear
        both = self._factor[:, None, None] * np.stack([p[self._second], p[self._first]], axis=1)
        values = self._fixed + np.bincount(self._put, both.ravel(), self._fixed.size)
        return csr_array((values, *self._pattern), shape=self._linear.shape)

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
        k, j = (3 * of[:, None] + np.arange(3) for of in (self._first, self._second))
        row, column = np.r_[k.ravel(), j.ravel()], np.r_[j.ravel(), k.ravel()]
        values = np.tile(np.repeat(value, 3), 2)
        size = self._linear.shape[1]
        return csr_array((values, (row, column)), shape=(size, size))

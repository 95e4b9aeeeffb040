"""The rows that joints are made of: g = 0, at most quadratic in averages of nodal places.

    point on point      p_A - p_B = 0                  three rows
    a ⊥ b               d_A · d_B = 0                  one row
    point in a plane    (p_B - p_A) · d_A = 0          one row

A row is g = Σ c p_i + Σ s p_k · p_l + constant, in metres: products of directions, which have no
unit, are multiplied by the size of the joint. As rows are quadratic, g(x₁) - g(x₀) is exactly the
gradient at the middle of a step times its increments (docs/theory/joints.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array
from rigidfx.effects.joints.coordinates import Coordinate
from rigidfx.effects.joints.face_motion import Vector

__all__ = ["Pieces", "Row", "Terms", "perpendiculars"]


@dataclass(frozen=True)
class Row:
    """A scalar constraint.

    Attributes:
        title: Direction that it holds, in words.
        linear: Number of an average, its component and the factor, of each linear term.
        products: Numbers of two averages and the factor, of each product.
    """

    title: str
    linear: tuple[tuple[int, int, float], ...] = ()
    products: tuple[tuple[int, int, float], ...] = ()


@dataclass
class Pieces:
    """The averages and rows of a joint, as they are put together.

    Attributes:
        size: Length that products of directions are multiplied by [m].
        mass: Mass that the joint moves, in order of magnitude [kg].
        averages: Vectors that rows are made of.
        sides: Side that each of them is of, 0 or 1.
        places: Whether each of them is a place, not a direction.
        rows: The rows.
        coordinates: Free coordinates of the joint, by name: "angle", "travel".
    """

    size: float
    mass: float
    averages: list[Vector] = field(default_factory=list)
    sides: list[int] = field(default_factory=list)
    places: list[bool] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    coordinates: dict[str, Coordinate] = field(default_factory=dict)

    def add(self, average: Vector, side: int) -> int:
        """Take an average of a side, 0 or 1; its number."""
        self.averages.append(average)
        self.sides.append(side)
        self.places.append(average.is_place)
        return len(self.averages) - 1

    def point_on_point(self, a: int, b: int) -> None:
        """Have two points in one place."""
        self.rows += [Row(axis, linear=((a, i, 1.0), (b, i, -1.0))) for i, axis in enumerate("xyz")]

    def perpendicular(self, a: int, b: int, title: str) -> None:
        """Have two directions perpendicular."""
        self.rows.append(Row(title, products=((a, b, self.size),)))

    def in_plane(self, a: int, b: int, normal: int, title: str) -> None:
        """Have two points in one plane across a direction."""
        self.rows.append(Row(title, products=((b, normal, 1.0), (a, normal, -1.0))))


def perpendiculars(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with a unit vector."""
    first: Array = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return first, np.asarray(np.cross(axis, first))


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

"""The rows that joints are made of: g = 0, at most quadratic in averages of nodal places.

    point on point      p_A - p_B = 0                  three rows
    a ⊥ b               d_A · d_B = 0                  one row
    point in a plane    (p_B - p_A) · d_A = 0          one row

A row is g = Σ c p_i + Σ s p_k · p_l + constant, in metres: products of directions, which have no
unit, are multiplied by the size of the joint. As rows are quadratic, g(x₁) - g(x₀) is exactly the
gradient at the middle of a step times its increments (docs/theory/joints.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array
from rigidfx.effects.joints.averages import Sided, Vector
from rigidfx.effects.joints.coordinates import Angle, Coordinate, Travel

__all__ = ["Pieces", "Row", "Terms"]


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


class Pieces:
    """The averages and rows of a joint: what it holds and leaves of a place and an axis.

    Each average is added when it is first needed.

    Attributes:
        size: Length that products of directions are multiplied by [m].
        mass: Mass that the joint moves, in order of magnitude [kg].
        averages: Vectors that rows are made of.
        sides: Side that each of them is of, 0 or 1.
        rows: The rows.
        coordinates: Free coordinates of the joint, by name: "angle", "travel".
    """

    def __init__(self, a: Sided, b: Sided, at: Array, axis: Array) -> None:
        """Begin without rows, at a place [m] and with an axis of unit length at the start."""
        self.size, self.mass = float(min(a.size, b.size)), float(min(a.mass, b.mass))
        self.averages: list[Vector] = []
        self.sides: list[int] = []
        self.rows: list[Row] = []
        self.coordinates: dict[str, Coordinate] = {}
        self._of, self._at, self._axis = (a, b), at, axis

    def _add(self, average: Vector, side: int) -> int:
        """Number of an average, which is added to a side."""
        self.averages.append(average)
        self.sides.append(side)
        return len(self.averages) - 1

    def direction(self, a: Array, side: int) -> int:
        """Number of a direction of a side, which is added."""
        return self._add(self._of[side].direction(a), side)

    @cached_property
    def points(self) -> tuple[int, int]:
        """Numbers of the place on both sides."""
        return self._add(self._of[0].place(self._at), 0), self._add(self._of[1].place(self._at), 1)

    @cached_property
    def along(self) -> int:
        """Number of the axis, which is of the first side."""
        return self.direction(self._axis, 0)

    @cached_property
    def across(self) -> tuple[int, int]:
        """Numbers of two directions across of the second side."""
        one, other = _perpendiculars(self._axis)
        return self.direction(one, 1), self.direction(other, 1)

    @cached_property
    def turned(self) -> int:
        """Number of the first of these directions on the first side."""
        return self.direction(_perpendiculars(self._axis)[0], 0)

    def hold(self, shared: Iterable[str], left: Iterable[str] = ()) -> None:
        """Add rows: point, axis, turn, line, plane; and free coordinates: angle, travel."""
        for name in (*(f"hold_{name}" for name in shared), *(f"leave_{name}" for name in left)):
            getattr(self, name)()

    def hold_point(self) -> None:
        """Add that both sides have the place in common."""
        a, b = self.points
        self.rows += [Row(axis, linear=((a, i, 1.0), (b, i, -1.0))) for i, axis in enumerate("xyz")]

    def hold_axis(self) -> None:
        """Add that both sides have the axis in common."""
        along = self.along
        for k, number in enumerate(self.across):
            self.hold_right_angle(along, number, f"tilt {k + 1}")

    def hold_turn(self) -> None:
        """Add that the sides do not turn about the axis."""
        self.hold_right_angle(self.turned, self.across[1], "turn")

    def hold_line(self) -> None:
        """Add that the places stay on one line along the axis."""
        for k, number in enumerate(self.across):
            self._hold_in_plane(number, f"across {k + 1}")

    def hold_plane(self) -> None:
        """Add that the places stay in one plane across the axis."""
        self._hold_in_plane(self.along, "normal")

    def hold_right_angle(self, a: int, b: int, title: str) -> None:
        """Add that two directions are perpendicular."""
        self.rows.append(Row(title, products=((a, b, self.size),)))

    def _hold_in_plane(self, normal: int, title: str) -> None:
        a, b = self.points
        self.rows.append(Row(title, products=((b, normal, 1.0), (a, normal, -1.0))))

    def leave_angle(self) -> None:
        """Measure the angle about the axis."""
        self.coordinates["angle"] = Angle((self.turned, *self.across))

    def leave_travel(self) -> None:
        """Measure the travel along the axis."""
        self.coordinates["travel"] = Travel((*self.points, self.along))


def _perpendiculars(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that make a right-handed frame with a unit vector."""
    first: Array = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return first, np.asarray(np.cross(axis, first))


class Terms:
    """g = Σ c p_i + Σ s p_k · p_l of many rows, at averages p of shape (averages, 3).

    With the components of all averages and a last one that is 1, x = [p, 1], each row is a sum of
    products f x_m x_n.

    Attributes:
        averages: Numbers of those that have a part in any row.
    """

    def __init__(self, rows: Sequence[Sequence[Row]], firsts: Sequence[int], averages: int) -> None:
        """Collect the rows of each joint, by the number of its first average."""
        every = [(row, first) for own, first in zip(rows, firsts, strict=False) for row in own]
        one, products, linear = 3 * averages, list[Any](), list[Any]()
        for r, (row, first) in enumerate(every):
            for k, j, s in row.products:
                products += [(r, 3 * (first + k) + i, 3 * (first + j) + i, s) for i in range(3)]
            linear += [(r, 3 * (first + k) + i, one, c) for k, i, c in row.linear]
        table = np.reshape([*products, *linear], (-1, 4))
        (self._row, self._m, self._n), self._f = table[:, :3].astype(np.int64).T, table[:, 3]
        self._count, self._both = len(every), len(products)
        own = slice(self._both)  # of these terms both factors change
        self._of = np.r_[self._row, self._row[own]]
        self._columns = np.r_[self._m, self._n[own]]
        self._gradient = Pattern(self._of, self._columns, (self._count, one))
        pairs = np.r_[self._m[own], self._n[own]], np.r_[self._n[own], self._m[own]]
        self._curvature = Pattern(*pairs, (one, one))
        self.averages = np.unique(self._columns // 3)

    def _sums(self, terms: Array) -> Array:
        """Sums of terms, or of entries of gradients, of each row."""
        of = self._row if terms.size == self._row.size else self._of
        return np.bincount(of, terms, self._count).astype(np.float64, copy=False)

    def value(self, p: Array) -> Array:
        """g, shape (rows,)."""
        x = np.append(p, 1.0)
        return self._sums(self._f * x[self._m] * x[self._n])

    def rounding(self, p: Array) -> Array:
        """Rounding of g at averages p, shape (rows,)."""
        x = np.append(p, 1.0)
        return np.asarray(4 * np.spacing(self._sums(np.abs(self._f * x[self._m] * x[self._n]))))

    def _entries(self, p: Array) -> Array:
        """Entries of the gradient at averages p."""
        x, own = np.append(p, 1.0), slice(self._both)
        return np.concatenate([self._f * x[self._n], self._f[own] * x[self._m[own]]])

    def gained(self, middle: Array, d: Array) -> Array:
        """Exact gain of g where averages are at middle half-way and move by d, shape (rows,)."""
        return self._sums(self._entries(middle) * d.ravel()[self._columns])

    def gradient(self, p: Array) -> Matrix:
        """∂g/∂p, shape (rows, 3 · averages)."""
        return self._gradient.filled(self._entries(p))

    def forces(self, p: Array, multipliers: Array) -> Array:
        """Σ λ ∂g/∂p at averages p, shape (averages, 3), by λ of each row."""
        entries = multipliers[self._of] * self._entries(p)
        sums = np.bincount(self._columns, entries, p.size)  # integers where there is none
        return sums.astype(np.float64, copy=False).reshape(-1, 3)

    def curvature(self, multipliers: Array, share: float) -> csr_array:
        """Derivative of Σ λ ∂g/∂p after a part of a step by p at its end, (3 · averages,) * 2."""
        own = slice(self._both)
        return self._curvature.sparse(
            np.tile(share * multipliers[self._row[own]] * self._f[own], 2)
        )

"""Rows that joints are made of, g = 0, at most quadratic in averages of nodal places; coordinates.

    point on point      p_A - p_B = 0                  three rows
    a ⊥ b               d_A · d_B = 0                  one row
    point in a plane    (p_B - p_A) · d_A = 0          one row

A row is g = Σ c p_i + Σ s p_k · p_l + constant, in metres: products of directions, which have no
unit, are multiplied by the size of the joint. A free coordinate, an angle or a travel, is a
function q(z) of two invariants z, products of averages. A force of it acts along the discrete
gradient of docs/theory/joints.md, in a lock too, where q stays. q₁ - q₀ is found from Δz: the
difference of two angles has the rounding of the angles, which the division by |Δz| magnifies where
a machine is nearly at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array, Ints
from rigidfx.effects.joints.averages import Sided, Vector

SMALL = 1e-5  # gain of invariants, in lengths of a joint or none, whose cube is rounding


@dataclass(frozen=True)
class Coordinate:
    """A free coordinate of a joint, by the numbers of three averages.

    Functions are of arrays over any number of them, of averages p of shape (..., 3, 3), and of
    invariants z of shape (..., 2).
    """

    averages: tuple[int, int, int]

    def slopes(self, p: Array) -> Array:
        """Derivatives of the invariants by the averages, shape (..., 2, 3, 3): linear in p."""
        raise NotImplementedError

    def of(self, z: Array) -> Array:
        """The coordinate, an angle between -π and π."""
        raise NotImplementedError

    def slope(self, z: Array) -> Array:
        """Its derivatives by the invariants, shape (..., 2)."""
        raise NotImplementedError

    def gained(self, z: Array, dz: Array) -> Array:
        """Its gain by a gain of the invariants, of an angle between -π and π."""
        raise NotImplementedError

    def continued(self, value: Array, before: Array) -> Array:
        """The value nearest to an earlier one, of those that are the same pose."""
        return value

    def invariants(self, p: Array) -> Array:
        """The invariants, products of averages, shape (..., 2)."""
        return 0.5 * _along(self.slopes(p), p)

    def value(self, p: Array) -> Array:
        """The coordinate where averages are at p."""
        return self.of(self.invariants(p))

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (..., 3, 3)."""
        slopes = self.slopes(p)
        return _chained(self.slope(0.5 * _along(slopes, p)), slopes)

    def secant(self, start: Array, moved: Array, size: Array | float) -> tuple[Array, Array]:
        """∇̄q of a step, shape (..., 3, 3), and q₁ - q₀, shape (...).

        Averages move from start by moved; q counts as large from `size` on.
        """
        slopes, z = self.slopes(start + 0.5 * moved), self.invariants(start)
        dz = _along(slopes, moved)
        slope, gained = self.slope(z + 0.5 * dz), self.gained(z, dz)
        unit: Array = np.ones_like(dz)
        unit[..., 0] = size
        scaled = dz / unit
        square = (scaled * scaled).sum(axis=-1)
        lacking = gained - (slope * dz).sum(axis=-1)
        none: Array = np.zeros_like(square)
        factor = np.divide(lacking, square, out=none, where=square > SMALL**2)
        return _chained(slope + factor[..., None] * scaled / unit, slopes), gained


class Angle(Coordinate):
    """The angle of the second side against the first about an axis [rad].

    The averages are a direction across of the first side, and two of the second. The invariants
    are its cosine and sine, times lengths of directions.
    """

    def slopes(self, p: Array) -> Array:
        """Derivatives of the cosine and the sine."""
        out = np.zeros((*p.shape[:-2], 2, 3, 3), p.dtype)
        out[..., 0, 0, :], out[..., 0, 1, :] = p[..., 1, :], p[..., 0, :]
        out[..., 1, 0, :], out[..., 1, 2, :] = -p[..., 2, :], -p[..., 0, :]
        return out

    def of(self, z: Array) -> Array:
        """The angle by its cosine and sine."""
        return np.asarray(np.arctan2(z[..., 1], z[..., 0]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the angle by its cosine and sine."""
        return z[..., ::-1] * (-1.0, 1.0) / (z * z).sum(axis=-1)[..., None]

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the angle by that of its cosine and sine."""
        (c, s), (dc, ds) = _split(z), _split(dz)
        return np.asarray(np.arctan2(c * ds - s * dc, c * (c + dc) + s * (s + ds)))

    def continued(self, value: Array, before: Array) -> Array:
        """The angle with the turns that it has made."""
        return np.asarray(value + 2 * pi * np.round((before - value) / (2 * pi)))


class Travel(Coordinate):
    """How far the second side is along an axis of the first, from where it was placed [m].

    The averages are the joint's place on both sides, and the axis. The invariants are the travel
    times the axis' length [m], and the square of that length.
    """

    def slopes(self, p: Array) -> Array:
        """Derivatives of the travel times the length, and of its square."""
        axis, out = p[..., 2, :], np.zeros((*p.shape[:-2], 2, 3, 3), p.dtype)
        out[..., 0, 0, :], out[..., 0, 1, :] = -axis, axis
        out[..., 0, 2, :], out[..., 1, 2, :] = p[..., 1, :] - p[..., 0, :], 2 * axis
        return out

    def of(self, z: Array) -> Array:
        """The travel, for an axis of any length."""
        return np.asarray(z[..., 0] / np.sqrt(z[..., 1]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the travel by both invariants."""
        along, square = _split(z)
        length = np.sqrt(square)
        return np.stack([1 / length, -0.5 * along / (square * length)], axis=-1)

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the travel, without its cancellation."""
        (along, square), (more, longer) = _split(z), _split(dz)
        before, after = np.sqrt(square), np.sqrt(square + longer)
        return np.asarray((more - along / before * longer / (before + after)) / after)


def _split(z: Array) -> tuple[Array, Array]:
    """Both invariants, shape (...) each."""
    return z[..., 0], z[..., 1]


def _along(slopes: Array, d: Array) -> Array:
    """Slopes times increments of averages, shape (..., 2)."""
    return np.asarray((slopes * d[..., None, :, :]).sum(axis=(-2, -1)))


def _chained(slope: Array, slopes: Array) -> Array:
    """Derivatives by averages of those by invariants and theirs, shape (..., 3, 3)."""
    return np.asarray((slope[..., None, None] * slopes).sum(axis=-3))


class Coordinates:
    """Many coordinates at once, each at three averages: `at`, shape (coordinates, 3)."""

    def __init__(self, of: Sequence[Coordinate], firsts: Sequence[int]) -> None:
        """Sort them by their kinds; `firsts` are the numbers of the first average of each joint."""
        averages = [first + np.array(c.averages) for c, first in zip(of, firsts, strict=True)]
        self.at: Ints = np.reshape(averages, (-1, 3)).astype(np.int64)
        kinds: dict[type[Coordinate], list[int]] = {}
        for k, coordinate in enumerate(of):
            kinds.setdefault(type(coordinate), []).append(k)
        self._kinds = [(of[own[0]], np.array(own)) for own in kinds.values()]

    def _each(self, shape: tuple[int, ...], found: Callable[[Coordinate, Ints], Array]) -> Array:
        """An array over all of them, by the numbers of those of each kind."""
        out: Array = np.empty((len(self.at), *shape))
        for kind, own in self._kinds:
            out[own] = found(kind, own)
        return out

    def values(self, p: Array, before: Array) -> Array:
        """Their values where averages are at p, turns counted by earlier values [rad, m]."""

        def found(kind: Coordinate, own: Ints) -> Array:
            return kind.continued(kind.value(p[self.at[own]]), before[own])

        return self._each((), found)

    def gradients(self, p: Array) -> Array:
        """Their derivatives by their averages at p, shape (coordinates, 3, 3)."""
        return self._each((3, 3), lambda kind, own: kind.gradient(p[self.at[own]]))

    def curvatures(self, p: Array) -> Array:
        """Their second derivatives by their averages at p, shape (coordinates, 9, 9).

        By complex steps: W. Squire, G. Trapp, SIAM Review 40 (1998) 110.
        """
        h = float(np.finfo(np.float64).eps)
        x = p[self.at][:, None] + 1j * h * np.eye(9).reshape(9, 3, 3)
        by_averages = self._each(
            (9, 3, 3), lambda kind, own: np.asarray(kind.gradient(x[own]).imag / h)
        )
        return by_averages.reshape(-1, 9, 9)

    def secants(self, start: Array, moved: Array, sizes: Array) -> tuple[Array, Array]:
        """∇̄q of a step, shape (coordinates, 3, 3), and q₁ - q₀: see `Coordinate.secant`."""
        slopes: Array = np.empty((len(self.at), 3, 3))
        gained: Array = np.empty(len(self.at))
        for kind, own in self._kinds:
            at = self.at[own]
            slopes[own], gained[own] = kind.secant(start[at], moved[at], sizes[own])
        return slopes, gained


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
    products f x_m x_n. `averages` are those that have a part in any row.
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

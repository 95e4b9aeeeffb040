"""Rows that joints are made of, g = 0, at most quadratic in averages of nodal places; coordinates.

    point on point      p_A - p_B = 0                  three rows
    a ⊥ b               d_A · d_B = 0                  one row
    point in a plane    (p_B - p_A) · d_A = 0          one row

A row is g = Σ c p_i + Σ s p_k · p_l + constant, in metres: products of directions, which have no
unit, are multiplied by the size of the joint. A free coordinate, an angle or a travel, is a
function q(z) of two invariants z = ½ p · B p, products of averages. A force of it acts along the
discrete gradient of docs/theory/joints.md, in a lock too, where q stays. q₁ - q₀ is found from Δz:
the difference of two angles has the rounding of the angles, which the division by |Δz| magnifies
where a machine is nearly at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.effects.joints.sides import Sided
from rigidfx.effects.joints.vectors import Vector

SMALL = 1e-5  # gain of invariants, in lengths of a joint or none, whose cube is rounding

# Coordinates ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Coordinate:
    """A free coordinate of a joint, by the numbers of three averages.

    Functions are of arrays over any number of them, of averages p of shape (..., 3, 3), and of
    invariants z of shape (..., 2).
    """

    turns: ClassVar[bool] = False  # whether values that differ by whole turns are one pose

    averages: tuple[int, int, int]

    @property
    def forms(self) -> Array:
        """B of both invariants, shape (2, 3, 3)."""
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

    def invariants(self, p: Array) -> tuple[Array, Array]:
        """The invariants, shape (..., 2), and their derivatives by the averages, (..., 2, 3, 3)."""
        slopes = self.forms @ p[..., None, :, :]
        return 0.5 * _along(slopes, p), slopes

    def value(self, p: Array, before: Array) -> Array:
        """The coordinate where averages are at p, of equal ones the nearest to an earlier value."""
        q = self.of(self.invariants(p)[0])
        return q + 2 * pi * np.round((before - q) / (2 * pi)) if self.turns else q

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (..., 3, 3)."""
        z, slopes = self.invariants(p)
        return _chained(self.slope(z), slopes)

    def secant(self, start: Array, moved: Array, large: Array) -> tuple[Array, Array]:
        """∇̄q of a step from start by moved, (..., 3, 3), and q₁ - q₀; `large` is a size of q."""
        (z, _), (_, slopes) = self.invariants(start), self.invariants(start + 0.5 * moved)
        dz = _along(slopes, moved)
        slope, gained = self.slope(z + 0.5 * dz), self.gained(z, dz)
        unit: Array = np.ones_like(dz)
        unit[..., 0] = large
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

    turns = True

    @cached_property
    def forms(self) -> Array:
        """B of the cosine p₁ · p₀ and the sine -p₂ · p₀."""
        return np.array([[[0, 1, 0], [1, 0, 0], [0, 0, 0]], [[0, 0, -1], [0, 0, 0], [-1, 0, 0.0]]])

    def of(self, z: Array) -> Array:
        """The angle by its cosine and sine."""
        return np.asarray(np.arctan2(z[..., 1], z[..., 0]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the angle by its cosine and sine."""
        return z[..., ::-1] * (-1.0, 1.0) / (z * z).sum(axis=-1)[..., None]

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the angle by that of its cosine and sine."""
        (c, s), (dc, ds) = np.moveaxis(z, -1, 0), np.moveaxis(dz, -1, 0)
        return np.asarray(np.arctan2(c * ds - s * dc, c * (c + dc) + s * (s + ds)))


class Travel(Coordinate):
    """How far the second side is along an axis of the first, from where it was placed [m].

    The averages are the joint's place on both sides, and the axis. The invariants are the travel
    times the axis' length [m], and the square of that length.
    """

    @cached_property
    def forms(self) -> Array:
        """B of (p₁ - p₀) · p₂ and p₂ · p₂."""
        return np.array([[[0, 0, -1], [0, 0, 1], [-1, 1, 0]], [[0, 0, 0], [0, 0, 0], [0, 0, 2.0]]])

    def of(self, z: Array) -> Array:
        """The travel, for an axis of any length."""
        return np.asarray(z[..., 0] / np.sqrt(z[..., 1]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the travel by both invariants."""
        along, square = np.moveaxis(z, -1, 0)
        length = np.sqrt(square)
        return np.stack([1 / length, -0.5 * along / (square * length)], axis=-1)

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the travel, without its cancellation."""
        (along, square), (more, longer) = np.moveaxis(z, -1, 0), np.moveaxis(dz, -1, 0)
        before, after = np.sqrt(square), np.sqrt(square + longer)
        return np.asarray((more - along / before * longer / (before + after)) / after)


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
        return self._each((), lambda kind, own: kind.value(p[self.at[own]], before[own]))

    def gradients(self, p: Array) -> Array:
        """Their derivatives by their averages at p, shape (coordinates, 3, 3)."""
        return self._each((3, 3), lambda kind, own: kind.gradient(p[self.at[own]]))

    def curvatures(self, p: Array) -> Array:
        """Their second derivatives by their averages at p, shape (coordinates, 9, 9).

        By complex steps: W. Squire, G. Trapp, SIAM Review 40 (1998) 110.
        """
        h = float(np.finfo(np.float64).eps)
        x = p[self.at][:, None] + 1j * h * np.eye(9).reshape(9, 3, 3)
        bent = self._each((9, 3, 3), lambda kind, own: np.asarray(kind.gradient(x[own]).imag / h))
        return bent.reshape(-1, 9, 9)

    def secants(self, start: Array, moved: Array, sizes: Array) -> tuple[Array, Array]:
        """∇̄q of a step, shape (coordinates, 3, 3), and q₁ - q₀: see `Coordinate.secant`."""
        slopes: Array = np.empty((len(self.at), 3, 3))
        gained: Array = np.empty(len(self.at))
        for kind, own in self._kinds:
            at = self.at[own]
            slopes[own], gained[own] = kind.secant(start[at], moved[at], sizes[own])
        return slopes, gained


# Rows -------------------------------------------------------------------------------------------

# Vectors of a joint are its place on both sides, a and b, its axis, first and second across that,
# and turned, which is the first one on the other side. These are of the first side:
FIRST_SIDE = ("a", "axis", "turned")
# By what both sides share: title of a row, and two directions that stay perpendicular.
RIGHT_ANGLES = {
    "axis": (("tilt 1", "axis", "first"), ("tilt 2", "axis", "second")),
    "turn": (("turn", "turned", "second"),),
}
# Likewise: title, and normal of a plane that both places are in.
PLANES = {"line": (("across 1", "first"), ("across 2", "second")), "plane": (("normal", "axis"),)}
# By the coordinate that is free: its kind and vectors.
FREE = {"angle": (Angle, ("turned", "first", "second")), "travel": (Travel, ("a", "b", "axis"))}


@dataclass(frozen=True)
class Row:
    """A scalar constraint."""

    title: str  # direction that it holds, in words
    linear: tuple[tuple[int, int, float], ...] = ()  # an average, its component, and the factor
    products: tuple[tuple[int, int, float], ...] = ()  # two averages and the factor


class Pieces:
    """The averages, rows and free coordinates of a joint at a place [m] with an axis."""

    def __init__(self, a: Sided, b: Sided, at: Array, axis: Array) -> None:
        """Begin without rows; the axis has unit length."""
        self.size = float(min(a.size, b.size))  # that products of directions are multiplied by [m]
        self.mass = float(min(a.mass, b.mass))  # that the joint moves, in order of magnitude [kg]
        self.averages: list[Vector] = []  # each is added when it is first needed
        self.sides: list[int] = []  # side that each of them is of, 0 or 1
        self.rows: list[Row] = []
        self.coordinates: dict[str, Coordinate] = {}  # by name: "angle", "travel"
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across = across / np.linalg.norm(across)
        self._of, self._at, self._numbers = (a, b), at, dict[str, int]()
        self._frame: dict[str, Any] = {"axis": axis, "first": across, "turned": across}
        self._frame["second"] = np.cross(axis, across)

    def _add(self, average: Vector, side: int) -> int:
        """Number of an average, which is added to a side."""
        self.averages.append(average)
        self.sides.append(side)
        return len(self.averages) - 1

    @property
    def places(self) -> Bools:
        """Whether each average is a place; the first one is the joint's on its first side."""
        return np.array([average.is_place for average in self.averages])

    def direction(self, a: Array, side: int) -> int:
        """Number of a direction of a side, which is added."""
        return self._add(self._of[side].direction(a), side)

    def _number(self, name: str) -> int:
        """Number of a vector by its name."""
        if name not in self._numbers:
            k, way = int(name not in FIRST_SIDE), self._frame.get(name)
            side = self._of[k]
            vector = side.place(self._at) if way is None else side.direction(way)
            self._numbers[name] = self._add(vector, k)
        return self._numbers[name]

    def hold(self, shared: Iterable[str], left: Iterable[str] = ()) -> None:
        """Add rows: point, axis, turn, line, plane; and free coordinates: angle, travel."""
        for held in shared:
            if held == "point":
                a, b = self._number("a"), self._number("b")
                ends = (((a, i, 1.0), (b, i, -1.0)) for i in range(3))
                self.rows += map(Row, "xyz", ends)
            for title, one, other in RIGHT_ANGLES.get(held, ()):
                self.hold_right_angle(self._number(one), self._number(other), title)
            for title, normal in PLANES.get(held, ()):
                a, b, n = (self._number(name) for name in ("a", "b", normal))
                self.rows.append(Row(title, products=((b, n, 1.0), (a, n, -1.0))))
        for free in left:
            kind, (one, other, last) = FREE[free]
            averages = self._number(one), self._number(other), self._number(last)
            self.coordinates[free] = kind(averages)

    def hold_right_angle(self, a: int, b: int, title: str) -> None:
        """Add that two directions are perpendicular."""
        self.rows.append(Row(title, products=((a, b, self.size),)))


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
        values = share * multipliers[self._row[own]] * self._f[own]
        return self._curvature.sparse(np.tile(values, 2))

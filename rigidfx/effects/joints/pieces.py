"""Rows that joints are made of, g = 0, at most quadratic in averages of nodal places; coordinates.

    point on point p_A - p_B = 0,    a ⊥ b: d_A · d_B = 0,    point in a plane (p_B - p_A) · d_A = 0

A row is g = Σ c p_i + Σ s p_k · p_l + constant, in metres. A free coordinate, an angle or a travel,
is a function q(z) of two invariants z, which are such rows; its force acts along the discrete
gradient of docs/theory/joints.md#coordinates, in a lock too. q₁ - q₀ is found from Δz: the
difference of two angles has their rounding, which the division by |Δz| magnifies near rest.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array, Bools
from rigidfx.effects.joints.sides import Sided
from rigidfx.effects.joints.vectors import Vector

SMALL = 1e-5  # gain of invariants, in lengths of a joint or none, whose cube is rounding


@dataclass(frozen=True)
class Row:
    """A scalar constraint."""

    title: str  # direction that it holds, in words
    linear: tuple[tuple[int, int, float], ...] = ()  # an average, its component, and the factor
    products: tuple[tuple[int, int, float], ...] = ()  # two averages and the factor


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


@dataclass(frozen=True)
class Angle:
    """The angle of the second side against the first about an axis [rad].

    The invariants are its cosine and sine, times lengths of directions, shape (2, ...). An angle,
    and a gain, is between -π and π.
    """

    turns: ClassVar[bool] = True  # whether values that differ by whole turns are one pose
    invariants: tuple[Row, Row]

    def of(self, z: Array) -> Array:
        """The angle by its cosine and sine."""
        return np.asarray(np.arctan2(z[1], z[0]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the angle by its cosine and sine."""
        return np.stack([-z[1], z[0]]) / (z * z).sum(axis=0)

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the angle by that of its cosine and sine."""
        (c, s), (dc, ds) = z, dz
        return np.asarray(np.arctan2(c * ds - s * dc, c * (c + dc) + s * (s + ds)))


@dataclass(frozen=True)
class Travel:
    """How far the second side is along an axis of the first, from where it was placed [m].

    The invariants are the travel times the axis' length [m], and the square of that length.
    """

    turns: ClassVar[bool] = False
    invariants: tuple[Row, Row]

    def of(self, z: Array) -> Array:
        """The travel, for an axis of any length."""
        return np.asarray(z[0] / np.sqrt(z[1]))

    def slope(self, z: Array) -> Array:
        """Derivatives of the travel by both invariants."""
        length = np.sqrt(z[1])
        return np.stack([1 / length, -0.5 * z[0] / (z[1] * length)])

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the travel, without its cancellation."""
        (along, square), (more, longer) = z, dz
        before, after = np.sqrt(square), np.sqrt(square + longer)
        return np.asarray((more - along / before * longer / (before + after)) / after)


Coordinate = Angle | Travel


class Coordinates(Terms):
    """Many coordinates at once, of all joints: first invariants, then second ones, are the rows."""

    def __init__(self, of: Sequence[Coordinate], firsts: Sequence[int], averages: int) -> None:
        """Sort them by their kinds; `firsts` are the numbers of the first average of each joint."""
        rows = [[coordinate.invariants[k]] for k in range(2) for coordinate in of]
        super().__init__(rows, [*firsts, *firsts], averages)
        self._turns = np.array([coordinate.turns for coordinate in of], dtype=bool)
        kinds = {type(coordinate): coordinate for coordinate in of}
        of_kind = (np.flatnonzero([isinstance(own, kind) for own in of]) for kind in kinds)
        self._kinds = list(zip(kinds.values(), of_kind, strict=True))
        count = max(len(of), 1)
        self._pattern = Pattern(self._of % count, self._columns, (len(of), 3 * averages))

    def _each(self, out: Array, method: str, *given: Array) -> Array:
        """Set an array of all of them by a method of each kind."""
        for kind, own in self._kinds:
            out[..., own] = getattr(kind, method)(*(values[..., own] for values in given))
        return out

    def _invariants(self, p: Array) -> Array:
        return self.value(p).reshape(2, -1)

    def values(self, p: Array, before: Array) -> Array:
        """Their values where averages are at p, turns counted by earlier values [rad, m]."""
        q = self._each(np.empty(len(before)), "of", self._invariants(p))
        return np.where(self._turns, q + 2 * pi * np.round((before - q) / (2 * pi)), q)

    def slopes(self, p: Array) -> Array:
        """Their derivatives by their invariants at p, shape (2, coordinates)."""
        z = self._invariants(p)
        return self._each(np.empty_like(z), "slope", z)

    def secants(self, start: Array, moved: Array, large: Array) -> tuple[Array, Array]:
        """Such derivatives with which Δz gives q₁ - q₀ in a step from start, and q₁ - q₀.

        A coordinate counts as large from `large` on.
        """
        z, dz = self._invariants(start), self.gained(start + 0.5 * moved, moved).reshape(2, -1)
        slope = self._each(np.empty_like(z), "slope", z + 0.5 * dz)
        gained = self._each(np.empty(len(large)), "gained", z, dz)
        unit: Array = np.stack([large, np.ones_like(large)])
        scaled = dz / unit
        square = (scaled * scaled).sum(axis=0)
        lacking = gained - (slope * dz).sum(axis=0)
        none: Array = np.zeros_like(square)
        factor = np.divide(lacking, square, out=none, where=square > SMALL**2)
        return slope + factor * scaled / unit, gained

    def chained(self, slopes: Array, p: Array) -> Matrix:
        """Derivatives by averages at p by those by invariants, (coordinates, 3 · averages)."""
        return self._pattern.filled(slopes.ravel()[self._of] * self._entries(p))

    def bent(self, p: Array, factors: Array) -> csr_array:
        """Second derivative of Σ f q by the averages at p, shape (3 · averages,) * 2.

        By complex steps of the invariants: W. Squire, G. Trapp, SIAM Review 40 (1998) 110.
        """
        h, z, G = float(np.finfo(np.float64).eps), self._invariants(p), self.gradient(p)
        steps = z[:, None] + 1j * h * np.eye(2)[:, :, None]
        slopes = self._each(np.empty_like(steps), "slope", steps).imag / h
        H = np.einsum("n,ijn,nm->injm", factors, slopes, np.eye(len(factors)))
        curved = csr_array(G.T @ H.reshape(2 * len(factors), -1) @ G)
        return csr_array(self.curvature((factors * self.slopes(p)).ravel(), 1.0) + curved)


# By what both sides share: title of a row, and two directions that stay perpendicular.
RIGHT_ANGLES = {
    "axis": (("tilt 1", "axis", "first"), ("tilt 2", "axis", "second")),
    "turn": (("turn", "turned", "second"),),
}
# Likewise: title, and normal of a plane that both places are in.
PLANES = {"line": (("across 1", "first"), ("across 2", "second")), "plane": (("normal", "axis"),)}


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
        # Its vectors: the side and direction of each; places have none.
        self._ways: dict[str, tuple[int, Any]] = {"a": (0, None), "b": (1, None), "axis": (0, axis)}
        self._ways |= {"first": (1, across), "second": (1, np.cross(axis, across))}
        self._ways["turned"] = 0, across

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
            side, way = self._ways[name]
            of = self._of[side]
            vector = of.place(self._at) if way is None else of.direction(way)
            self._numbers[name] = self._add(vector, side)
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
            self.coordinates[free] = getattr(self, f"_{free}")()

    def _angle(self) -> Angle:
        first, second, turned = (self._number(name) for name in ("first", "second", "turned"))
        sine = Row("sine", products=((second, turned, -1.0),))
        return Angle((Row("cosine", products=((first, turned, 1.0),)), sine))

    def _travel(self) -> Travel:
        a, b, axis = (self._number(name) for name in ("a", "b", "axis"))
        along = Row("travel", products=((b, axis, 1.0), (a, axis, -1.0)))
        return Travel((along, Row("length", products=((axis, axis, 1.0),))))

    def hold_right_angle(self, a: int, b: int, title: str) -> None:
        """Add that two directions are perpendicular."""
        self.rows.append(Row(title, products=((a, b, self.size),)))

"""Free coordinates of joints: angle and travel, with their gradients.

A coordinate is a function q(z) of two invariants z, products of averages p, whose gains are
exactly ∇z(p½) · Δp. A force of it acts along the discrete gradient (O. Gonzalez, J. Nonlinear Sci.
6 (1996) 449)

    ∇̄q = [∂q(z½) + (q₁ - q₀ - ∂q(z½) · Δz) Δz/|Δz|²] · ∇z(p½),

so that ∇̄q · Δp = q₁ - q₀ exactly. That holds in a lock, too, where q stays. As z does not see
rigid motions, such forces have no resultant. q₁ - q₀ is found from Δz: the difference of two angles
has the rounding of the angles, which the division by |Δz| magnifies where a machine is nearly at
rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from rigidfx.base.types import Array, Ints

__all__ = ["Angle", "Coordinate", "Coordinates", "Travel", "secant"]


SMALL = 1e-5  # gain of invariants, in lengths of a joint or none, whose cube is rounding


@dataclass(frozen=True)
class Angle:
    """The angle of the second side against the first about an axis [rad].

    Its functions are of arrays over any number of angles, shape (...).

    Attributes:
        averages: Numbers of a direction across of the first side, and of two of the second.
    """

    averages: tuple[int, int, int]

    def value(self, p: Array) -> Array:
        """The angle between -π and π.

        Args:
            p: The three averages, shape (..., 3, 3).
        """
        c, s = _split(self.invariants(p))
        return np.asarray(np.arctan2(s, c))

    def invariants(self, p: Array) -> Array:
        """Cosine and sine, times lengths of directions, shape (..., 2)."""
        products = (p[..., 1:, :] @ p[..., 0, :, None])[..., 0]
        products[..., 1] *= -1.0
        return np.asarray(products)

    def slopes(self, p: Array) -> Array:
        """Derivatives of these by the averages, shape (..., 2, 3, 3)."""
        out = np.zeros((*p.shape[:-2], 2, 3, 3))
        out[..., 0, 0, :], out[..., 0, 1, :] = p[..., 1, :], p[..., 0, :]
        out[..., 1, 0, :], out[..., 1, 2, :] = -p[..., 2, :], -p[..., 0, :]
        return out

    def slope(self, z: Array) -> Array:
        """Derivatives of the angle by the invariants, shape (..., 2)."""
        return z[..., ::-1] * (-1.0, 1.0) / (z * z).sum(axis=-1)[..., None]

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the angle by a gain of the invariants, between -π and π."""
        (c, s), (dc, ds) = _split(z), _split(dz)
        return np.asarray(np.arctan2(c * ds - s * dc, c * (c + dc) + s * (s + ds)))

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (..., 3, 3)."""
        return _chained(self.slope(self.invariants(p)), self.slopes(p))

    def continued(self, value: Array, before: Array) -> Array:
        """The angle with the turns that it has made, nearest to an earlier one."""
        return np.asarray(value + 2 * pi * np.round((before - value) / (2 * pi)))


@dataclass(frozen=True)
class Travel:
    """How far the second side is along an axis of the first, from where it was placed [m].

    Its functions are of arrays over any number of travels, shape (...).

    Attributes:
        averages: Numbers of the joint's place on both sides, and of the axis.
    """

    averages: tuple[int, int, int]

    def value(self, p: Array) -> Array:
        """The travel [m].

        Args:
            p: The three averages, shape (..., 3, 3).
        """
        along, square = _split(self.invariants(p))
        return np.asarray(along / np.sqrt(square))

    def invariants(self, p: Array) -> Array:
        """The travel times the axis' length [m], and the square of that, shape (..., 2)."""
        axis = p[..., 2, :]
        both = np.stack([p[..., 1, :] - p[..., 0, :], axis], axis=-2)
        return np.asarray((both @ axis[..., None])[..., 0])

    def slopes(self, p: Array) -> Array:
        """Derivatives of these by the averages, shape (..., 2, 3, 3)."""
        axis, out = p[..., 2, :], np.zeros((*p.shape[:-2], 2, 3, 3))
        out[..., 0, 0, :], out[..., 0, 1, :] = -axis, axis
        out[..., 0, 2, :], out[..., 1, 2, :] = p[..., 1, :] - p[..., 0, :], 2 * axis
        return out

    def slope(self, z: Array) -> Array:
        """Derivatives of the travel by the invariants, shape (..., 2)."""
        along, square = _split(z)
        length = np.sqrt(square)
        return np.stack([1 / length, -0.5 * along / (square * length)], axis=-1)

    def gained(self, z: Array, dz: Array) -> Array:
        """Gain of the travel by a gain of the invariants."""
        (along, square), (more, longer) = _split(z), _split(dz)
        before, after = np.sqrt(square), np.sqrt(square + longer)
        return np.asarray((more - along / before * longer / (before + after)) / after)

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (..., 3, 3)."""
        return _chained(self.slope(self.invariants(p)), self.slopes(p))

    def continued(self, value: Array, before: Array) -> Array:
        """The travel itself."""
        return value


Coordinate = Angle | Travel


def _split(z: Array) -> tuple[Array, Array]:
    """Both invariants, shape (...) each."""
    return z[..., 0], z[..., 1]


def _chained(slope: Array, slopes: Array) -> Array:
    """Derivatives by averages of those by invariants and theirs, shape (..., 3, 3)."""
    return np.asarray((slope[..., None, None] * slopes).sum(axis=-3))


class Coordinates:
    """Many of them at once.

    Attributes:
        at: Numbers of the averages of each, shape (coordinates, 3).
    """

    def __init__(self, of: Sequence[Coordinate], firsts: Sequence[int]) -> None:
        """Take them.

        Args:
            of: Each of them.
            firsts: Number of the first average of each one's joint.
        """
        averages = [first + np.array(c.averages) for c, first in zip(of, firsts, strict=True)]
        self.at: Ints = np.reshape(averages, (-1, 3)).astype(np.int64)
        kinds: dict[type[Coordinate], list[int]] = {}
        for k, coordinate in enumerate(of):
            kinds.setdefault(type(coordinate), []).append(k)
        self._kinds = [(of[own[0]], np.array(own)) for own in kinds.values()]

    def __len__(self) -> int:
        """How many there are."""
        return len(self.at)

    def values(self, p: Array, before: Array) -> Array:
        """Their values where averages are at p, shape (coordinates,) [rad, m].

        Args:
            p: Shape (averages, 3).
            before: Earlier values, by which turns are counted.
        """
        out: Array = np.empty(len(self.at))
        for kind, own in self._kinds:
            out[own] = kind.continued(kind.value(p[self.at[own]]), before[own])
        return out

    def gradients(self, p: Array) -> Array:
        """Their derivatives by their averages at p, shape (coordinates, 3, 3)."""
        out: Array = np.empty((len(self.at), 3, 3))
        for kind, own in self._kinds:
            out[own] = kind.gradient(p[self.at[own]])
        return out

    def curvatures(self, p: Array) -> Array:
        """Their second derivatives by their averages at p, shape (coordinates, 9, 9).

        By central differences of gradients, which depend on directions, of length 1, and are linear
        in places.
        """
        step, out = float(np.cbrt(np.finfo(np.float64).eps)), np.empty((len(self.at), 9, 9))
        for kind, own in self._kinds:
            x, moves = p[self.at[own]], step * np.eye(9).reshape(9, 3, 3)
            slopes = [kind.gradient(x + d) - kind.gradient(x - d) for d in moves]
            out[own] = np.stack(slopes, axis=1).reshape(-1, 9, 9) / (2 * step)
        return out

    def secants(self, start: Array, moved: Array, sizes: Array) -> tuple[Array, Array]:
        """∇̄q of a step, shape (coordinates, 3, 3), and q₁ - q₀, shape (coordinates,).

        Args:
            start: The averages at the start of the step, shape (averages, 3).
            moved: Their increments, likewise.
            sizes: Size of each q that counts as large.
        """
        slopes: Array = np.empty((len(self.at), 3, 3))
        gained: Array = np.empty(len(self.at))
        for kind, own in self._kinds:
            at = self.at[own]
            slopes[own], gained[own] = secant(kind, start[at], moved[at], sizes[own])
        return slopes, gained


def secant(
    kind: Coordinate, start: Array, moved: Array, size: Array | float
) -> tuple[Array, Array]:
    """∇̄q of a step, shape (..., 3, 3), and q₁ - q₀, shape (...).

    Args:
        kind: One of the coordinates, all of one kind.
        start: The averages of each at the start of the step, shape (..., 3, 3).
        moved: Their increments, likewise.
        size: Size of each q that counts as large, shape (...).
    """
    slopes, z = kind.slopes(start + 0.5 * moved), kind.invariants(start)
    dz = (slopes * moved[..., None, :, :]).sum(axis=(-2, -1))
    slope, gained = kind.slope(z + 0.5 * dz), kind.gained(z, dz)
    unit: Array = np.ones_like(dz)
    unit[..., 0] = size
    scaled = dz / unit
    square = (scaled * scaled).sum(axis=-1)
    much = square > SMALL**2
    lacking = gained - (slope * dz).sum(axis=-1)
    factor = np.divide(lacking, square, out=np.zeros_like(square), where=much)
    return _chained(slope + factor[..., None] * scaled / unit, slopes), gained

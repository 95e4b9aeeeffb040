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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
import numpy.typing as npt

__all__ = ["Angle", "Coordinate", "Coordinates", "Travel", "secant"]

Array = npt.NDArray[np.float64]
Key = tuple[int, str]

SMALL = 1e-5  # gain of invariants, in lengths of a joint or none, whose cube is rounding


@dataclass(frozen=True)
class Angle:
    """The angle of the second side against the first about an axis [rad].

    Attributes:
        averages: Numbers of a direction across of the first side, and of two of the second.
    """

    averages: tuple[int, int, int]

    def value(self, p: Array) -> float:
        """The angle between -π and π.

        Args:
            p: The three averages, shape (3, 3).
        """
        u, e, f = p
        return float(np.arctan2(-u @ f, u @ e))

    def invariants(self, p: Array) -> Array:
        """Cosine and sine, times lengths of directions, shape (2,)."""
        u, e, f = p
        return np.array([u @ e, -u @ f])

    def slopes(self, p: Array) -> Array:
        """Derivatives of these by the averages, shape (2, 3, 3)."""
        u, e, f = p
        none = np.zeros(3)
        return np.array([[e, u, none], [-f, none, -u]])

    def slope(self, z: Array) -> Array:
        """Derivatives of the angle by the invariants, shape (2,)."""
        c, s = z
        return np.array([-s, c]) / (c * c + s * s)

    def gained(self, z: Array, dz: Array) -> float:
        """Gain of the angle by a gain of the invariants, between -π and π."""
        (c, s), (dc, ds) = z, dz
        return float(np.arctan2(c * ds - s * dc, c * (c + dc) + s * (s + ds)))

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (3, 3)."""
        return np.asarray(np.tensordot(self.slope(self.invariants(p)), self.slopes(p), 1))

    def continued(self, value: float, before: float) -> float:
        """The angle with the turns that it has made, nearest to an earlier one."""
        return value + 2 * pi * round((before - value) / (2 * pi))


@dataclass(frozen=True)
class Travel:
    """How far the second side is along an axis of the first, from where it was placed [m].

    Attributes:
        averages: Numbers of the joint's place on both sides, and of the axis.
    """

    averages: tuple[int, int, int]

    def value(self, p: Array) -> float:
        """The travel [m].

        Args:
            p: The three averages, shape (3, 3).
        """
        a, b, axis = p
        return float((b - a) @ axis / np.linalg.norm(axis))

    def invariants(self, p: Array) -> Array:
        """The travel times the axis' length [m], and the square of that, shape (2,)."""
        a, b, axis = p
        return np.array([(b - a) @ axis, axis @ axis])

    def slopes(self, p: Array) -> Array:
        """Derivatives of these by the averages, shape (2, 3, 3)."""
        a, b, axis = p
        none = np.zeros(3)
        return np.array([[-axis, axis, b - a], [none, none, 2 * axis]])

    def slope(self, z: Array) -> Array:
        """Derivatives of the travel by the invariants, shape (2,)."""
        along, square = z
        length = np.sqrt(square)
        return np.array([1 / length, -0.5 * along / (square * length)])

    def gained(self, z: Array, dz: Array) -> float:
        """Gain of the travel by a gain of the invariants."""
        before, after = np.sqrt(z[1]), np.sqrt(z[1] + dz[1])
        longer = dz[1] / (before + after)
        return float((dz[0] - z[0] / before * longer) / after)

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (3, 3)."""
        return np.asarray(np.tensordot(self.slope(self.invariants(p)), self.slopes(p), 1))

    def continued(self, value: float, before: float) -> float:
        """The travel itself."""
        return value


Coordinate = Angle | Travel


class Coordinates:
    """Many of them at once, by joint and name."""

    def __init__(self, of: Mapping[Key, Coordinate], firsts: Sequence[int]) -> None:
        """Take them.

        Args:
            of: Each of them, by number of its joint and its name.
            firsts: Number of each joint's first average.
        """
        self.keys = tuple(of)
        self._turns = np.array([isinstance(c, Angle) for c in of.values()], dtype=bool)
        at = [firsts[k] + np.array(c.averages) for (k, _), c in of.items()]
        self._at = np.reshape(at, (-1, 3)).astype(np.int64)

    def values(self, p: Array, before: Array) -> Array:
        """Their values where averages are at p, shape (coordinates,) [rad, m].

        Args:
            p: Shape (averages, 3).
            before: Earlier values, by which turns are counted.
        """
        x = p[self._at]
        out: Array = np.zeros(len(self.keys))
        u, e, f = x[self._turns].swapaxes(0, 1)
        angles = np.arctan2(-(u * f).sum(axis=1), (u * e).sum(axis=1))
        out[self._turns] = angles + 2 * pi * np.round((before[self._turns] - angles) / (2 * pi))
        a, b, axis = x[~self._turns].swapaxes(0, 1)
        out[~self._turns] = ((b - a) * axis).sum(axis=1) / np.sqrt((axis * axis).sum(axis=1))
        return out


def secant(coordinate: Coordinate, start: Array, moved: Array, size: float) -> tuple[Array, float]:
    """∇̄q of a step, shape (3, 3), and q₁ - q₀.

    Args:
        coordinate: q.
        start: The averages at the start of the step, shape (3, 3).
        moved: Their increments, likewise.
        size: Size of q that counts as large.
    """
    slopes = coordinate.slopes(start + 0.5 * moved)
    z: Array = coordinate.invariants(start)
    dz: Array = np.asarray(np.tensordot(slopes, moved, 2), dtype=np.float64)
    slope, gained = coordinate.slope(z + 0.5 * dz), coordinate.gained(z, dz)
    scaled = dz / np.array([size, 1.0])
    if (square := float(scaled @ scaled)) > SMALL**2:
        slope = slope + (gained - slope @ dz) / square * scaled / np.array([size, 1.0])
    return np.asarray(np.tensordot(slope, slopes, 1)), gained

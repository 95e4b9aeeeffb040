"""Free coordinates of joints: angle and travel, with their gradients.

A force of a coordinate q acts along ∇q at the middle of a step, scaled so that its product with the
increments is exactly the gain of q (O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449):

    ∇̄q = ∇q(p½) · (q₁ - q₀) / (∇q(p½) · Δp).

As q does not see rigid motions, such forces have no resultant.
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

SMALL = 1e-5  # gain, in rad or lengths of a joint, whose square is rounding


@dataclass(frozen=True)
class Angle:
    """The angle of the second side against the first about an axis [rad].

    Attributes:
        averages: Numbers of a direction across of one side, and of two of the other.
        sign: 1 if the other side is the first one, else -1.
    """

    averages: tuple[int, int, int]
    sign: float

    def value(self, p: Array) -> float:
        """The angle between -π and π.

        Args:
            p: The three averages, shape (3, 3).
        """
        u, e, f = p
        return self.sign * float(np.arctan2(u @ f, u @ e))

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (3, 3)."""
        u, e, f = p
        c, s = u @ e, u @ f
        return np.asarray(self.sign / (c * c + s * s) * np.stack([c * f - s * e, -s * u, c * u]))

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

    @property
    def sign(self) -> float:
        """The axis is the first side's or parallel to it, always."""
        return 1.0

    def value(self, p: Array) -> float:
        """The travel [m].

        Args:
            p: The three averages, shape (3, 3).
        """
        a, b, axis = p
        return float((b - a) @ axis / np.linalg.norm(axis))

    def gradient(self, p: Array) -> Array:
        """Its derivatives by the averages, shape (3, 3)."""
        a, b, axis = p
        length = np.linalg.norm(axis)
        n = axis / length
        across = (b - a) - ((b - a) @ n) * n
        return np.stack([-n, n, across / length])

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
        self._signs = np.array([c.sign for c in of.values()], dtype=np.float64)

    def values(self, p: Array, before: Array) -> Array:
        """Their values where averages are at p, shape (coordinates,) [rad, m].

        Args:
            p: Shape (averages, 3).
            before: Earlier values, by which turns are counted.
        """
        x = p[self._at]
        out: Array = np.zeros(len(self.keys))
        u, e, f = x[self._turns].swapaxes(0, 1)
        angles = np.arctan2((u * f).sum(axis=1), (u * e).sum(axis=1)) * self._signs[self._turns]
        out[self._turns] = angles + 2 * pi * np.round((before[self._turns] - angles) / (2 * pi))
        a, b, axis = x[~self._turns].swapaxes(0, 1)
        out[~self._turns] = ((b - a) * axis).sum(axis=1) / np.sqrt((axis * axis).sum(axis=1))
        return out


def secant(coordinate: Coordinate, start: Array, moved: Array, gained: float, size: float) -> Array:
    """∇̄q of a step, shape (3, 3).

    Args:
        coordinate: q.
        start: The averages at the start of the step, shape (3, 3).
        moved: Their increments, likewise.
        gained: q₁ - q₀.
        size: Size of q that counts as large.
    """
    middle = coordinate.gradient(start + 0.5 * moved)
    along = float(np.vdot(middle, moved))
    return middle if abs(along) <= SMALL * size else middle * (gained / along)

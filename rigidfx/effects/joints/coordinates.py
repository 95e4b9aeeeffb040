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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from rigidfx.base.types import Array, Ints

__all__ = ["Angle", "Coordinate", "Coordinates", "Travel"]


SMALL = 1e-5  # gain of invariants, in lengths of a joint or none, whose cube is rounding


@dataclass(frozen=True)
class Coordinate:
    """A free coordinate of a joint.

    Functions are of arrays over any number of them, of averages p of shape (..., 3, 3), and of
    invariants z of shape (..., 2).

    Attributes:
        averages: Numbers of the three averages.
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
    """Many coordinates at once.

    Attributes:
        at: Numbers of the averages of each, shape (coordinates, 3).
    """

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
        by_averages = self._each((9, 3, 3), lambda kind, own: kind.gradient(x[own]).imag / h)
        return by_averages.reshape(-1, 9, 9)

    def secants(self, start: Array, moved: Array, sizes: Array) -> tuple[Array, Array]:
        """∇̄q of a step, shape (coordinates, 3, 3), and q₁ - q₀: see `Coordinate.secant`."""
        slopes: Array = np.empty((len(self.at), 3, 3))
        gained: Array = np.empty(len(self.at))
        for kind, own in self._kinds:
            at = self.at[own]
            slopes[own], gained[own] = kind.secant(start[at], moved[at], sizes[own])
        return slopes, gained

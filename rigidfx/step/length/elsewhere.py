"""Errors that are made elsewhere in a structure, and come to the points that are asked for.

Excitation of many modes at once shows at a point as their sum, which may vanish while each of them
errs: the tip of a cantilever moves freely until the wave from its root arrives, and its jerk tells
nothing of it. Modes do not cancel in the mean square over a structure, as they are orthogonal. So
the root mean square of the errors of nodes all over it counts as well, as a part of how they move:

    e = max( e_p , e_s min(1, U_p/U_s) ) ,    e_s = sqrt(mean |e_k|²) ,    U_s² = max mean |u_k|² ,

U_p being the largest displacement so far of the points that are asked for. Where these move more
than others their own error counts (without the bound a spin-up was told 5.7 times its error, with
it 3.3).
"""

from __future__ import annotations

from math import sqrt
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same

__all__ = ["Elsewhere"]

Array = npt.NDArray[np.float64]


class Elsewhere:
    """Knows how far points have moved, those that are asked for and all others."""

    remembered: ClassVar[Remembered] = same("_moved")

    def __init__(self, asked: int) -> None:
        """Nothing has moved.

        Args:
            asked: How many points are asked for, the first of all.
        """
        self._asked = asked
        self._moved = self._next = 0.0, 0.0

    def look(self, errors: Array, u: Array) -> float:
        """Error of a step that has been solved at the points that are asked for [m].

        Args:
            errors: Of each point in it, shape (points,) [m]; NaN if unknown, of all alike.
            u: Displacements at its end, shape (points, 3) [m].

        Returns:
            NaN if nothing is known.
        """
        n, squares = self._asked, np.einsum("ij,ij->i", u, u)
        moved, others = sqrt(squares[:n].max()), _mean(squares[n:])
        self._next = max(self._moved[0], moved), max(self._moved[1], others)
        return float(self.at_asked(errors[None])[0])

    def at_asked(self, lengths: Array) -> Array:
        """Lengths at all points, converted to those that are asked for, shape (n,) [m].

        Args:
            lengths: Shape (n, points) [m].
        """
        n, (here, there) = self._asked, self._next
        found: Array = lengths[:, :n].max(axis=1)
        if lengths.shape[1] > n and there > 0:
            mean = np.sqrt(np.mean(lengths[:, n:] ** 2, axis=1))
            found = np.maximum(found, mean * min(1.0, here / there))
        return found

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._moved = self._next


def _mean(squares: Array) -> float:
    """Root of a mean."""
    return sqrt(squares.sum() / squares.size) if squares.size else 0.0

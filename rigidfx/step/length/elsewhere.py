"""Errors that are made elsewhere in a structure, and come to the points that are asked for.

What excites many modes at once shows at a point as their sum, which may vanish while each of them
errs: the tip of a cantilever moves freely until the wave from its root arrives, and its jerk tells
nothing of it. Modes do not cancel in the mean square over a structure, as they are orthogonal. So
the root mean square of the errors of nodes all over it counts as well, as a part of how they move:

    e = max( e_p , e_s min(1, U_p/U_s) ) ,    e_s = sqrt(mean |e_k|²) ,    U_s² = max mean |u_k|² ,

U_p being the largest displacement so far of the points that are asked for. Where these move more
than others their own error tells what they do (without the bound a spin-up was told 5.7 times its
error, with it 3.3).
"""

from __future__ import annotations

from math import nan

import numpy as np
import numpy.typing as npt

__all__ = ["Elsewhere"]

Array = npt.NDArray[np.float64]


class Elsewhere:
    """Knows how far points have moved, those that are asked for and all others."""

    def __init__(self, asked: int) -> None:
        """Nothing has moved.

        Args:
            asked: How many points are asked for, the first of all.
        """
        self._asked = asked
        self._moved: Array = np.zeros(2)
        self._next: Array = self._moved

    def look(self, errors: Array, u: Array) -> float:
        """Error of a step that has been solved at the points that are asked for [m].

        Args:
            errors: Of each point in it, shape (points,) [m]; NaN where unknown.
            u: Displacements at its end, shape (points, 3) [m].

        Returns:
            NaN if nothing is known.
        """
        n = self._asked
        at, others = errors[:n][~np.isnan(errors[:n])], errors[n:][~np.isnan(errors[n:])]
        self._next = np.maximum(self._moved, [_largest(u[:n]), _mean(u[n:])])
        here, there = self._next
        if not at.size:
            return nan
        found = float(at.max())
        if others.size and there > 0:
            found = max(found, _mean(others[:, None]) * min(1.0, here / there))
        return found

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._moved = self._next


def _largest(vectors: Array) -> float:
    return float(np.sqrt(np.einsum("ij,ij->i", vectors, vectors).max(initial=0.0)))


def _mean(vectors: Array) -> float:
    """Root of the mean square of vectors' sizes."""
    return float(np.sqrt(np.einsum("ij,ij->", vectors, vectors) / max(len(vectors), 1)))

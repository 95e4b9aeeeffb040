"""Errors at other places of a structure, which travel to the points where accuracy is asked.

The tip of a cantilever does not move until the wave from its root arrives: the jerks of many modes
cancel there, while each mode has an error. Modes are orthogonal, so they do not cancel in the mean
square over a structure. So the root mean square over nodes counts as well, in relation to their
displacements:

    d = max( d_p , d_s min(1, U_p/U_s) ) ,    d_s = sqrt(mean |d_k|²) ,    U_s² = max mean |u_k|² ,

with U_p the largest displacement so far of the points where accuracy is asked. If these move more
than others, their own error counts.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array


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

    def look(self, u: Array) -> None:
        """See how far points have moved at the end of a step, shape (points, 3) [m]."""
        moved, others = self._both(np.linalg.norm(u, axis=1)[None])
        self._next = max(self._moved[0], float(moved[0])), max(self._moved[1], float(others[0]))

    def worth(self, lengths: Array) -> Array:
        """Lengths at all points, shape (n, points), as those that are asked for, shape (n,) [m]."""
        own, others = self._both(lengths)
        here, there = self._next
        return np.maximum(own, others * min(1.0, here / there)) if there > 0 else own

    def _both(self, lengths: Array) -> tuple[Array, Array]:
        """The largest at the points that are asked for, and the root mean square at others."""
        n = self._asked
        others = np.sqrt(np.sum(lengths[:, n:] ** 2, axis=1) / max(lengths.shape[1] - n, 1))
        return lengths[:, :n].max(axis=1), others

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._moved = self._next

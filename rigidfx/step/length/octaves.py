"""How much of a signal is slower than this and that: low-passed by octaves.

Four exponential means, one of the other, let 1/(1 + (ω/ω_b)²)² of a vibration through. Where rates
at which vibrations are forgotten go with ω², what is let through at ω_b, over the rate of ½ ω_b, is
most for ω_b = ω, and that of the vibration itself (.9 to 1 of it, wherever ω lies between octaves;
two thirds where little of it is forgotten in a run). So of accounts that forget at these rates the
largest is right where all is one vibration, and knows of a slow one however much faster another is.
"""

from __future__ import annotations

from math import log2, nan
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same

__all__ = ["Octaves"]

Array = npt.NDArray[np.float64]

STAGES = 4
OF_CUT = 0.5  # of ω_b: the frequency whose rate goes with what is let through
MOST = 24


class Octaves:
    """Low-passes vectors at some points.

    Attributes:
        cuts: ω_b [1/s].
    """

    remembered: ClassVar[Remembered] = same("_known", "_parts")

    def __init__(self, points: int, time: float, step: float) -> None:
        """Nothing has been seen.

        Args:
            points: How many points there are.
            time: Length of the run, in which slower vibrations than one over it do not turn [s].
            step: Shortest step, which resolves none faster than one over it [s].
        """
        count = min(max(int(np.ceil(log2(time / step))), 1), MOST)
        self.cuts: Array = np.exp2(np.arange(count, dtype=np.float64)) / time
        # The signal and its means, one of the other, and what a step of some length makes of them.
        self._known: Array = np.zeros((count, 1 + STAGES, 3 * points))
        self._step: Array = np.empty(0)
        self._dt = nan
        self._next: Array = self._known[:, 1:]
        self._parts: Array = np.ones(count)

    def look(self, vectors: Array, sizes: Array, dt: float) -> Array:
        """The rest of some vectors above each cut, the largest of all points over their sizes.

        Args:
            vectors: Of each point, in a step that has been solved, shape (points, 3); NaN if
                nothing is known, of all alike.
            sizes: Root mean squares of these as they swing, shape (points,); NaN likewise.
            dt: Time since the last ones [s].
        """
        size = float(sizes.max(initial=0.0))
        if not size > 0:
            self._next = self._known[:, 1:]
            return self._parts
        if dt != self._dt:
            self._step, self._dt = _means(-np.expm1(-self.cuts * dt)), dt
        self._known[:, 0] = vectors.ravel()
        self._next = self._step @ self._known
        slowest = self._next[:, -1].reshape(self.cuts.size, -1, 3)
        left = np.einsum("bpi,bpi->bp", slowest, slowest).max(axis=1)
        return np.asarray(np.sqrt(left) / size)

    def accept(self, parts: Array) -> None:
        """Take note that the step that was looked at last is one, with its rest."""
        self._known[:, 1:], self._parts = self._next, parts


def _means(taken: Array) -> Array:
    """New means, one of the other, of a signal and old ones, shape (cuts, STAGES, 1 + STAGES).

    Args:
        taken: Part of its input that comes into each mean, shape (cuts,).
    """
    rows = [np.eye(1 + STAGES)[0] + np.zeros((taken.size, 1))]
    for own in np.eye(1 + STAGES)[1:]:
        rows.append(taken[:, None] * rows[-1] + (1 - taken)[:, None] * own)
    return np.stack(rows[1:], axis=1)

"""How much of a signal is slower than this and that: low-passed by octaves.

Four exponential means, one of the other, let 1/(1 + (ω/ω_b)²)² of a vibration through. Where rates
at which vibrations are forgotten go with ω², what is let through at ω_b, over the rate of ½ ω_b, is
most for ω_b = ω, and that of the vibration itself (.9 to 1 of it, wherever ω lies between octaves;
two thirds where little of it is forgotten in a run). So of accounts that forget at these rates the
largest is right where all is one vibration, and knows of a slow one however much faster another is.
"""

from __future__ import annotations

from math import log2

import numpy as np
import numpy.typing as npt

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

    def __init__(self, points: int, time: float, step: float) -> None:
        """Nothing has been seen.

        Args:
            points: How many points there are.
            time: Length of the run, in which slower vibrations than one over it do not turn [s].
            step: Shortest step, which resolves none faster than one over it [s].
        """
        count = min(max(int(np.ceil(log2(time / step))), 1), MOST)
        self.cuts: Array = np.exp2(np.arange(count, dtype=np.float64)) / time
        self._means: Array = np.zeros((STAGES, count, points, 3))
        self._next: Array = self._means
        self._parts: Array = np.ones(count)

    def look(self, vectors: Array, dt: float) -> Array:
        """What each cut leaves of some vectors, the largest of all points over theirs.

        Args:
            vectors: Of each point, in a step that has been solved, shape (points, 3); NaN where
                nothing is known.
            dt: Time since the last ones [s].
        """
        known = np.isfinite(vectors)
        size = float(np.linalg.norm(np.where(known, vectors, 0.0), axis=1).max(initial=0.0))
        if not known.any() or size == 0:
            self._next = self._means
            return self._parts
        taken = -np.expm1(-self.cuts * dt)[:, None, None]
        signal: Array = vectors
        self._next = self._means.copy()
        for mean in self._next:
            mean += np.where(known, taken * (signal - mean), 0.0)
            signal = mean
        return np.asarray(np.linalg.norm(self._next[-1], axis=2).max(axis=1) / size)

    def accept(self, parts: Array) -> None:
        """Take note that the step that was looked at last is one, with what was left in it."""
        self._means, self._parts = self._next, parts

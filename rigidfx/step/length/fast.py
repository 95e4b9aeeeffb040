"""How far points swing by motion faster than each cut.

Steps that do not resolve a vibration turn its phase, and by that displacements err by twice its
amplitude at most, however long it goes on. So for any cut ω_b the error of steps is below the sum
of their errors in slower motion and twice the amplitude of faster motion. That bound is the best at
some cut, mostly at the one where a phase is wrong by about two.

The amplitude is that of displacements high-passed four times, (x²/(1 + x²))² of a vibration with x
= ω/½ω_b: an octave below the low-pass at ω_b (`rigidfx.step.length.octaves`), so that the two
together miss nothing. Four times, as a body flies and turns while it vibrates: of a path that goes
with t³ nothing is left.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same

__all__ = ["Fast"]

Array = npt.NDArray[np.float64]

STAGES = 4
OF_CUT = 0.5  # of ω_b, above which motion counts as faster
REMEMBERED = 12.0  # times 1/½ω_b, two periods, in which the largest swing stands for the amplitude


class Fast:
    """High-passes the displacements of some points.

    Attributes:
        amplitudes: Amplitude of motion faster than each cut, at the points that are asked for,
            shape (cuts,) [m].
    """

    remembered: ClassVar[Remembered] = same("_known", "amplitudes")

    def __init__(self, cuts: Array, points: int) -> None:
        """Nothing has moved.

        Args:
            cuts: ω_b [1/s].
            points: How many points there are.
        """
        self._cuts: Array = OF_CUT * cuts
        # Displacements and what each stage leaves of them.
        self._known: Array = np.zeros((1 + STAGES, cuts.size, 3 * points))
        self._next = self._known
        self.amplitudes: Array = np.zeros(cuts.size)
        self._lasting = self.amplitudes

    def swings(self, u: Array, dt: float) -> Array:
        """How far each point is off its slower motion, shape (cuts, points) [m].

        Args:
            u: Displacements at the end of a step that has been solved, shape (points, 3) [m].
            dt: Its length [s].
        """
        z = (self._cuts * dt)[:, None]
        kept, taken = np.exp(-z), -np.expm1(-z) / z
        new: Array = np.empty_like(self._known)
        new[0] = u.ravel()
        for k in range(STAGES):  # as if all went evenly within a step
            new[k + 1] = kept * self._known[k + 1] + taken * (new[k] - self._known[k])
        self._next = new
        off = new[-1].reshape(self._cuts.size, -1, 3)
        return np.asarray(np.sqrt(np.einsum("bpi,bpi->bp", off, off)))

    def look(self, swings: Array, dt: float) -> None:
        """Find amplitudes at the end of a step that has been solved.

        Args:
            swings: At the points that are asked for, shape (cuts,) [m].
            dt: Its length [s].
        """
        faded = self.amplitudes * np.exp(-self._cuts * dt / REMEMBERED)
        self._lasting = np.maximum(faded, swings)

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._known, self.amplitudes = self._next, self._lasting

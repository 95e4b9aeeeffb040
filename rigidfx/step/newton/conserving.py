"""Whether an iterate that is good enough as a solution keeps energy and momenta as well.

Newton's method often ends a step with a residual many orders below where it may stop; iterations
with a kept tangent end just there. In steps in which waves get far that may be energy and momenta,
which drift: by 2e-10 in 300 steps of a bar of steel whose Δt changed from step to step. So the loss
of a solution is measured. Where that is too much the iteration goes on, for as long as it falls by
half. Where it does not, with a new tangent neither, it is rounding: its size is remembered, by
later divisions too, and later steps are not asked for less. An iteration that has made it worse is
taken back.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.step.newton.stopping_test import ROUNDING

__all__ = ["Conserving"]

Array = npt.NDArray[np.float64]

SLOW = 0.5  # factor by which what falls in an iteration is no rounding
GROWN = 2.0  # a residual that has grown by that belongs to no solution any more


class Conserving:
    """Follows the iterates of a step from the first one that is good enough as a solution.

    Attributes:
        rounding: Rounding of each quantity, as far as it has been met, relative.
        best: Whether no iterate before the last one, of those that were followed, was better.
        doubtful: Whether the next iteration wants a new tangent, to tell rounding from a tangent
            that does not fit.
        asked: How many iterations it has asked for in this step.
    """

    def __init__(self, tolerance: float) -> None:
        """Begin without a step.

        Args:
            tolerance: Permitted loss of energy and momenta in a step, relative.
        """
        self._tolerance = tolerance
        self.rounding: float | Array = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin a step, or an attempt at it."""
        self._lost: list[Array] = []
        self._residual = self._least = np.inf
        self.best, self.doubtful, self.asked = True, False, 0

    @property
    def following(self) -> bool:
        """Whether there has been a solution already, which takes too much."""
        return bool(self._lost)

    def grown(self, residual: float) -> bool:
        """Whether an iterate is none to go on from. True ends the step.

        Args:
            residual: ‖R‖ there [N].
        """
        self.best = residual <= GROWN * self._residual
        return not self.best

    def enough(self, residual: float, lost: Array, kept: bool = False) -> bool:
        """Whether an iterate is to be the last; another one is asked for if not.

        Args:
            residual: ‖R‖ there [N].
            lost: Loss of each quantity, relative.
            kept: Whether tangents are kept: that of the last iteration was an earlier one, unless
                this one was in doubt.
        """
        enough = self._enough(residual, lost, kept)
        self.asked += not enough
        return enough

    def _enough(self, residual: float, lost: Array, kept: bool) -> bool:
        self._lost.append(lost)
        if np.shape(self.rounding) not in ((), lost.shape):
            self.rounding = 0.0  # it was met while other quantities were looked at
        self._residual = min(self._residual, residual)
        allowed = np.maximum(self._tolerance, ROUNDING * self.rounding)
        worst = float((lost / allowed).max(initial=0.0))
        self.best, self._least = worst <= self._least, min(worst, self._least)
        much = lost > allowed
        if len(self._lost) > 1:
            before, older = self._lost[-2], kept and not self.doubtful
            stays = much & (lost > SLOW * before)
            self.doubtful = older and bool(stays.any())
            if self.doubtful:
                return False
            met = np.where(stays, np.minimum(lost, before), 0.0)
            self.rounding = np.maximum(self.rounding, met)
            much &= ~stays
        return not much.any()

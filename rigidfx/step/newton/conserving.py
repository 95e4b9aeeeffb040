"""Whether an iterate that is accurate enough as a solution also keeps energy and momenta.

Newton's method often ends a step far below its tolerance. Iterations with a kept tangent end just
below it. In long steps that remainder may change energy and momenta: they drifted by 2e-10 in 300
steps of a bar of steel whose Δt changed from step to step. So the change by a solution is measured.
If it is too large, the iteration continues while each iteration halves it. If a new tangent does
not halve it either, it is rounding. The size of that rounding is kept, also through new divisions,
and later steps need not be better. An iterate with a larger change than the one before is undone.
"""

from __future__ import annotations

import numpy as np

from rigidfx.base.types import Array
from rigidfx.step.newton.stopping_test import ROUNDING

__all__ = ["Conserving"]


SLOW = 0.5  # factor by which what falls in an iteration is no rounding
GROWN = 2.0  # a residual that has grown by that belongs to no solution any more


class Conserving:
    """Follows the iterates of a step from the first one that is good enough as a solution.

    Attributes:
        rounding: Rounding of each quantity, as far as it has been met, relative.
        best: Whether no iterate before the last one, of those that were followed, was better.
        doubtful: Whether the next iteration wants a new tangent, to tell rounding from a tangent
            that does not fit.
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
        self.best, self.doubtful = True, False

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

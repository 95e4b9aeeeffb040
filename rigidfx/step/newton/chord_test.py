"""When an iteration with a kept tangent stops: linear convergence leaves more than quadratic does.

Newton's next iterate is so much better that the last one's residual is all rounding where it looks
like it. With a kept tangent the residual falls by one factor ρ in each iteration, and what the last
iterate has left is ρ times what the one before had, whether rounding hides it or not. So the
iteration goes on below rounding, until what must be left is a tenth of what is seen; a biased
rest, however small, would sum up over the steps and show as a drift of energy and momenta. And a
residual that falls more slowly than before is no stall: the tangent may not fit. Only where a new
one does no better, rounding is met, and where that is is remembered.
"""

from __future__ import annotations

import math

from rigidfx.step.newton.refresh import SLOW
from rigidfx.step.newton.stopping_test import (
    MARGIN,
    MAX_ITERATIONS,
    RELATIVE_TOLERANCE,
    STALL,
    StoppingTest,
)

__all__ = ["ChordTest"]

HIDDEN = 0.1  # of a residual of rounding, what truncation may be
SEEN = 100.0  # times the least residual that has been met, what rounding may be at most
RESTING = 1e-3  # of its estimate, what it is at least, though what is at rest shows none
STAYING = 5  # iterates that do not fall, all of rounding's size, before a new tangent is asked
UNKNOWN = 0.3  # contraction of a tangent that has not shown any
NEWTON_ERROR = 2.0  # contraction of a tangent, times that of the first iteration with it


class ChordTest(StoppingTest):
    """The stopping test of solves with tangents that are kept."""

    def __init__(self, rtol: float = RELATIVE_TOLERANCE, max_it: int = MAX_ITERATIONS) -> None:
        """Begin with no tangent."""
        super().__init__(HIDDEN * rtol, max_it)
        self._contraction = 0.0  # the worst that the present tangent has shown ...
        self._before = 0.0  # ... until the last iterate
        self._renewed_at = -1  # iterate; -1 if the tangent is an earlier step's
        self._left = 0.0  # ‖R‖ that rounding may hide
        # Where stalls have been met, and the least that has been, as parts of what R is the
        # difference of.
        self._floor, self._least = 0.0, math.inf

    def restart(self) -> None:
        """Forget the iterates, not what the tangent is worth."""
        super().restart()
        self._renewed_at = -1

    def renewed(self) -> None:
        """Take note of a new tangent at the last iterate."""
        self._renewed_at = len(self.history) - 1
        self._contraction = 0.0

    @property
    def target(self) -> float:
        """‖R‖ that ends the step [N]."""
        return max(self.rtol * self.history[0], self._level)

    @property
    def stuck(self) -> bool:
        """Whether only a new tangent will tell that what is left is rounding."""
        last = self.history[-STAYING:]
        if self._renewed_at >= 0 or len(last) < STAYING:
            return False
        return max(last) <= self._level and min(last[1:]) > SLOW * last[0]

    @property
    def _level(self) -> float:
        """Below which rounding may be all of ‖R‖: estimates of it are far too large at times."""
        if not self._noise > 0:  # not estimated yet
            return self.rounding
        seen = max(SEEN * self._least * self._noise, RESTING * self.rounding)
        return max(min(self.rounding, seen), self._floor * self._noise)

    def __call__(self, iteration: int, norm: float) -> int:
        """SNES's reason to stop, or 0 to go on; as of the base class."""
        if iteration == 0:
            self._left = norm
        else:
            self._learn(norm)
        if norm > 0 and self._noise > 0:
            self._least = min(self._least, norm / self._noise)
        return super().__call__(iteration, norm)

    def _learn(self, norm: float) -> None:
        """See how fast the residual falls, and what must be left of it."""
        self._before = self._contraction
        # A first guess may be nearer than what a tangent of an earlier step makes of it.
        worse = len(self.history) == 1 and norm > self.history[0]
        if norm > self._level and not worse:
            self._contraction = max(self._contraction, min(self._seen(norm), 1.0))
        self._left = min(norm, (self._contraction or UNKNOWN) * self._left)

    def _seen(self, norm: float) -> float:
        """By how much the residual falls in an iteration."""
        n, last = len(self.history), self.history[-1]
        if n - 1 == self._renewed_at:
            return NEWTON_ERROR * norm / last
        if n - 2 <= max(self._renewed_at, 0) or norm > SLOW * last:
            return norm / last
        # Over two iterations, as what is left of strains and of rotations may take turns; the first
        # one falls by more than those after it.
        return math.sqrt(norm / self.history[-2])

    def _at_rounding(self) -> bool:
        """Whether all that is left of the residual is rounding."""
        last, norm = self.history[-2:]
        if norm > MARGIN * self._level:
            return False
        if self._left <= max(self.rtol * self.history[0], HIDDEN * norm):
            return True
        newest = self._renewed_at == len(self.history) - 2
        if newest and STALL * last < norm <= last:
            self._floor = max(self._floor, norm / self._noise)
            self._contraction = self._before  # rounding says nothing of the tangent
            return True
        return False

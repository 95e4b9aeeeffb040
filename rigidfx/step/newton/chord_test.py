"""When an iteration with a kept tangent stops: at a tenth of Newton's tolerance, or at rounding.

With a kept tangent the residual falls by one factor in each iteration. A factor near one need not
be a stall, since the tangent may not fit. Only if a tangent of the same step does no better, the
rest is rounding. Its size, relative to the terms that R is the difference of, is kept, and later
solutions stop there. The change of energy and momenta is measured in any case, see `conserving`.
"""

from __future__ import annotations

from rigidfx.step.newton.stopping_test import (
    HIDDEN,
    MARGIN,
    MAX_ITERATIONS,
    RELATIVE_TOLERANCE,
    ROUNDING,
    STALL,
    StoppingTest,
)

__all__ = ["ChordTest"]


class ChordTest(StoppingTest):
    """The stopping test of solves with tangents that are kept."""

    def __init__(self, rtol: float = RELATIVE_TOLERANCE, max_it: int = MAX_ITERATIONS) -> None:
        """Begin with no tangent."""
        super().__init__(HIDDEN * rtol, max_it)
        self._floor = 0.0  # ‖R‖ at which a new tangent did no better, as a part of what R is of

    @property
    def _goal(self) -> float:
        return self.rtol

    @property
    def target(self) -> float:
        """‖R‖ that ends the step [N]."""
        return max(self.rtol * self.first, ROUNDING * self._floor * self._noise)

    def _at_rounding(self) -> bool:
        """Whether all that is left of the residual is rounding."""
        last, norm = self.history[-2:]
        if norm <= ROUNDING * self._floor * self._noise:
            # Less is learned, more is not: else it would double from step to step.
            self._floor = max(min(norm / self._noise, self._floor), self._floor / ROUNDING)
            return True
        if self._renewed_at < 0 or not STALL * last < norm <= max(ROUNDING * last, self.rounding):
            return False
        newest = self._renewed_at == len(self.history) - 2
        if norm <= (MARGIN if newest else 1) * self.rounding:
            self._floor = norm / self._noise
            return True
        return False

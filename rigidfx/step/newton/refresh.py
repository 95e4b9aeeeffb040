"""When a kept tangent is assembled and factored anew: a rule in counts, the same on all ranks.

An iteration with a kept tangent costs a residual and a solve with its factors; to renew it costs as
much as `cost` of them. In a step, a tangent that no longer fits is renewed as soon as that is seen:
where the residual falls by less than half, or where what is left to do would take more iterations
than a new one costs. Between steps it is renewed when the last step took more iterations than an
average one since the last renewal, that included: from then on each further step would only raise
the average.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["SLOW", "Refresh"]

SLOW = 0.5  # contraction of the residual beyond which a tangent does not fit
TAKEN_ANYHOW = 3  # iterations that a new tangent needs as well


class Refresh:
    """Counts iterations and says when a tangent is worth renewing.

    Attributes:
        cost: What a tangent costs, in iterations with a kept one.
        due: Whether the next step begins with a new tangent.
    """

    def __init__(self, cost: float) -> None:
        """Begin without a tangent."""
        self.cost, self.due = cost, True
        self._spent, self._steps, self._since = 0.0, 0, 0

    def begin(self) -> None:
        """Begin a step, or an attempt at it."""
        self._since = 0

    def wanted(self, history: Sequence[float], target: float) -> bool:
        """Whether the tangent is to be renewed at the last iterate.

        Args:
            history: ‖R‖ at each iterate of this step.
            target: ‖R‖ below which the iteration does not tell how fast it converges.
        """
        if self.due:
            return True
        if len(history) - 1 - self._since < 2 or history[-1] <= target:
            return False  # nothing is known yet, or nothing left that would show
        before, last, norm = history[-3:]
        if norm > SLOW * last:
            return True
        # Over two iterations, as what is left of strains and of rotations may take turns.
        left = 2 * math.log(norm / max(target, 1e-300)) / math.log(before / norm)
        return left > self.cost + TAKEN_ANYHOW

    def renewed(self, history: Sequence[float]) -> None:
        """Take note of a new tangent at the last iterate."""
        self.due = False
        self._since = len(history) - 1
        self._spent, self._steps = self.cost - self._since, 0

    def accepted(self, iterations: int) -> None:
        """Take note of a step that took so many iterations."""
        self._spent += iterations
        self._steps += 1
        self.due = iterations - self._since > self._spent / self._steps

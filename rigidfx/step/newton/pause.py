"""When kept tangents pause, in favour of Newton's method: a rule in counts, alike on all ranks.

A step of a soft part by Newton's method and GMRES costs as much as so many iterations with a kept
tangent: that is what it is `worth`. Where steps with kept tangents cost more in the mean, new
tangents included, Newton's method has its turn for a while, after which they are tried again. So it
has where solves with them fail again and again: a contact that opens and closes goes by, and what
is stiff gains too much by kept tangents to do without them for good.
"""

from __future__ import annotations

__all__ = ["Pause"]

LENGTH = 30  # steps
MEMORY = 10.0  # steps that the mean goes over
MAX_FAILURES = 3  # solves in a row after which it pauses; another one after the pause does too


class Pause:
    """Counts what steps cost, and says when others are to be tried."""

    def __init__(self) -> None:
        """Begin with steps that cost nothing."""
        self._mean, self._left = 0.0, 0  # steps
        self._failures = 0  # in a row

    @property
    def over(self) -> bool:
        """Whether tangents are to be kept at present."""
        return self._left == 0

    @property
    def failed(self) -> bool:
        """Whether they pause as they have failed."""
        return self._failures >= MAX_FAILURES and self._left > 0

    def failure(self) -> None:
        """Take note of a solve with kept tangents that has failed."""
        self._failures += 1
        if self._failures >= MAX_FAILURES:
            self._left = LENGTH

    def kept(self, cost: float) -> None:
        """Take note of a step with kept tangents.

        Args:
            cost: What it cost, new tangents included, in steps by Newton's method.
        """
        self._failures = 0
        self._mean += (cost - self._mean) / MEMORY
        if self._mean > 1.0:
            self._mean, self._left = 0.0, LENGTH

    def passed(self) -> None:
        """Take note of a step by Newton's method."""
        self._left = max(0, self._left - 1)

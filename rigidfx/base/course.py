"""The largest value so far, and its past values."""

from bisect import bisect_left, bisect_right
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same

APART = 1.02  # factor between values that are remembered


class Course:
    """Remembers the growth of a largest value."""

    remembered: ClassVar[Remembered] = same("largest", "_times", "_sizes")

    def __init__(self) -> None:
        """It is zero at the time 0."""
        self.largest = 0.0
        # Until when it was no more than that; the last one may still be.
        self._times, self._sizes = [0.0], [0.0]

    def add(self, value: float, start: float, t: float) -> None:
        """Record a value, reached between two times [s]."""
        if self.largest == value == 0:
            self._times[0] = t
        if value <= self.largest:
            return
        self.largest = value
        if value > APART * self._sizes[-1]:
            self._times[-1] = start
            self._times.append(t)
            self._sizes.append(value)

    def at(self, t: float) -> float:
        """The largest value up to t [s]."""
        return self._sizes[min(bisect_left(self._times, t), len(self._sizes) - 1)]

    def until(self, value: float) -> float:
        """Time up to which it was no more than a value [s]."""
        return self._times[max(bisect_right(self._sizes, value) - 1, 0)]

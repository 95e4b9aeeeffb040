"""How far a run is off its flexible twin, beside what it may be."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["Astray"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

SETTLED = 0.5  # of what releases bodies, what is off as they freeze: what is off rings on


class Astray:
    """Remembers how far a run is off.

    Attributes:
        now: How far any node is, of all ranks [m]; None if that is not known.
        limits: What that may be for the sake of each owned cell [m]; None while that is not known.
    """

    def __init__(self) -> None:
        """Nothing is known."""
        self.now: float | None = None
        self.limits: Array | None = None
        self._most = 0.0  # in the window

    @property
    def known(self) -> bool:
        """Whether anything tells."""
        return self.now is not None

    def window_begins(self) -> None:
        """Forget the last window."""
        self._most = self.now or 0.0

    def add(self, off: float | None) -> None:
        """Take note of a step, after which a run is off by so much [m]."""
        self.now = off
        self._most = max(self._most, off or 0.0)

    def too_far(self, cells: int) -> Bools:
        """Owned cells that may not be rigid any more; none while nothing is known."""
        return self._beyond(self.now, 1.0, cells)

    def unsettled(self, cells: int) -> Bools:
        """Owned cells that may not become rigid at the end of a window; likewise."""
        return self._beyond(None if self.now is None else self._most, SETTLED, cells)

    def _beyond(self, off: float | None, part: float, cells: int) -> Bools:
        if off is None or self.limits is None:
            return np.zeros(cells, dtype=bool)
        return np.asarray(off > part * self.limits)

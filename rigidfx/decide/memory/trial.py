"""Whether a freeze will last, as its first steps show.

Cells on the neutral axis of a beam hardly strain, and are quiet. As a body they are a spine, and
hold the bend of all cells round them. Nothing tells that before they are rigid; but what their body
withholds then grows, from the first steps on, by more than cells so quiet could strain. If it goes
on as it does, some of them come near what wakes them by the end of a window, or until what moves
turns round. Then the freeze is undone as a whole, before there is much to set free.
"""

from __future__ import annotations

from math import inf, isfinite

import numpy as np
import numpy.typing as npt

__all__ = ["Trial"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

FIRST, LAST = 2, 4  # looks after a freeze; the one before sees the kick of the freeze itself
ENOUGH = 0.5  # of what wakes cells, that fails


class Trial:
    """Follows the cells of the last freeze.

    Attributes:
        cells: Owned cells on trial.
    """

    def __init__(self, cells: int) -> None:
        """Nothing has frozen.

        Args:
            cells: Number of owned cells.
        """
        self.cells: Bools = np.zeros(cells, dtype=bool)
        self._looks, self._since = LAST, 0.0
        self._first: tuple[float, Array] = 0.0, np.zeros(cells)

    @property
    def over(self) -> bool:
        """Whether nothing is on trial; the same on all ranks."""
        return self._looks >= LAST

    def begin(self, cells: Bools, t: float) -> None:
        """Have cells on trial that have frozen at t [s]."""
        self.cells, self._since, self._looks = cells, t, 0

    def end(self) -> None:
        """Have nothing on trial: there are other bodies."""
        self._looks = LAST

    def failed(self, strains: Array, t: float, window: float, turning: float) -> bool:
        """Whether cells on trial on this rank will withhold too much; at one look only.

        Args:
            strains: Strain that each owned cell has withheld since the freeze, over what wakes it.
            t: Time of this look [s].
            window: Length of a window [s].
            turning: Time in which what moves turns round [s]; zero where windows do not tell.
        """
        if self.over:
            return False
        self._looks += 1
        if self._looks <= FIRST:
            self._first = t, strains.copy()
        if self._looks < LAST:
            return False
        before, then = self._first
        left = min(max(self._since + window - t, 0.0), turning or inf)
        if not isfinite(left):
            return False
        expected = strains + np.maximum(strains - then, 0.0) * left / (t - before)
        return bool((expected[self.cells] > ENOUGH).any())

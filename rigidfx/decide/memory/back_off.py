"""Waiting times against repeated switches: cells that are released early wait longer.

A changing load, or a condition of the user's, may release cells that have just become rigid. A
window later they would freeze again, and be released again. This saves no time, and each switch
loses the phase of a vibration. A release is *hasty* if a cell was observed for longer than it was
rigid. After n hasty releases in a row a cell has to qualify in γⁿ⁻¹ windows in a row before it may
become rigid again: in one window after the first hasty release, in γ windows after the second. In a
time T there are then about log T/log γ switches instead of T/T_red. Any other release resets the
count.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.instants import longer
from rigidfx.base.remembered import ON_CELLS, Remembered
from rigidfx.base.types import Array, Bools

__all__ = ["BackOff"]


class BackOff:
    """Keeps, for each owned cell, how long it has qualified and how hastily it was released.

    Attributes:
        hasty: Number of hasty releases in a row.
        windows: Number of windows in a row in which a cell has qualified.
        observed: Their length [s].
        rigid_since: When a cell became rigid [s]; NaN while it is flexible.
    """

    remembered: ClassVar[Remembered] = dict.fromkeys(
        ("windows", "observed", "rigid_since", "hasty"), ON_CELLS
    )

    def __init__(self, cells: int, growth: float) -> None:
        """Nothing has been observed.

        Args:
            cells: Number of owned cells.
            growth: γ ≥ 1; 1 lets cells never wait.
        """
        self._growth = growth
        self.hasty = np.zeros(cells, dtype=np.int64)
        self.windows = np.zeros(cells, dtype=np.int64)
        self.observed = np.zeros(cells)
        self.rigid_since = np.full(cells, np.nan)

    @property
    def rigid(self) -> Bools:
        """Which cells were rigid at the last `switched`."""
        return ~np.isnan(self.rigid_since)

    def needed(self) -> Array:
        """Windows in a row in which each cell has to qualify."""
        return self._growth ** np.maximum(self.hasty - 1, 0)

    def restart(self) -> None:
        """Something has changed: forget the observations of flexible cells."""
        flexible = np.isnan(self.rigid_since)
        self.windows[flexible], self.observed[flexible] = 0, 0.0

    def lasting(self, able: Bools) -> Bools:
        """Of the cells that have qualified in a window, those that have waited long enough.

        Args:
            able: Cells that have qualified in the window that ends now.
        """
        return able & ~longer(self.needed(), self.windows + 1)

    def window_ended(self, able: Bools, length: float) -> None:
        """Record the end of a window.

        Args:
            able: Cells that have qualified.
            length: Length of the window [s].
        """
        self.windows[able] += 1
        self.observed[able] += length
        failed = ~able & np.isnan(self.rigid_since)
        self.windows[failed], self.observed[failed] = 0, 0.0

    def switched(self, rigid: Bools, t: float, counts: bool) -> bool:
        """Record which cells are rigid after an event.

        Args:
            rigid: Cells in bodies.
            t: Time [s].
            counts: Whether a hasty release counts; one that was planned does not.

        Returns:
            Whether a cell has to wait longer from now on.
        """
        was = self.rigid
        released, frozen = was & ~rigid, rigid & ~was
        soon = released & longer(self.observed, t - self.rigid_since)
        if counts:
            self.hasty[soon] += 1
            self.hasty[released & ~soon] = 0
        self.rigid_since[frozen], self.rigid_since[released] = t, np.nan
        self.windows[released], self.observed[released] = 0, 0.0
        return bool(counts and self._growth > 1 and (self.hasty[soon] > 1).any())

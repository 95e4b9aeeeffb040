"""The window of observation: the largest strain rate of each cell since it began."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_CELLS, Remembered, same
from rigidfx.base.types import Array, Indices

__all__ = ["Window"]


class Window:
    """Largest strain rate of each cell since the window began.

    Attributes:
        start: Time at which it began [s].
        worst: Per owned cell [1/s].
        steps: Number of steps observed.
        whole: Whether a cell has been flexible in all of them.
        over: Whether it has its length.
    """

    remembered: ClassVar[Remembered] = same("start", "steps", "over") | {
        "worst": ON_CELLS,
        "whole": ON_CELLS,
    }

    def __init__(self, cells: int, start: float) -> None:
        """A window that begins.

        Args:
            cells: Number of owned cells.
            start: Time [s].
        """
        self.start, self.worst, self.steps = start, np.zeros(cells), 0
        self.whole = np.ones(cells, dtype=bool)
        self.over = False

    def add(self, cells: Indices, rates: Array) -> None:
        """Observe a step.

        Args:
            cells: Flexible owned cells.
            rates: Their strain rates [1/s].
        """
        self.worst[cells] = np.maximum(self.worst[cells], rates)
        self.steps += 1

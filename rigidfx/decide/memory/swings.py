"""The swing of the strain of each cell in a window: its largest minus its smallest value."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_CELLS, Remembered
from rigidfx.base.types import Array, Indices

__all__ = ["Swings"]


class Swings:
    """The least and the most strain of each cell since a window began.

    Strains are magnitudes. So the swing of a vibration about zero is its amplitude, that of a
    vibration about a larger strain twice its amplitude.
    """

    remembered: ClassVar[Remembered] = {"_least": ON_CELLS, "_most": ON_CELLS}

    def __init__(self, cells: int) -> None:
        """Nothing has been observed.

        Args:
            cells: Number of owned cells.
        """
        self._least, self._most = np.full(cells, np.inf), np.full(cells, -np.inf)

    def add(self, cells: Indices, strains: Array) -> None:
        """Observe the end of a step.

        Args:
            cells: Flexible owned cells.
            strains: Of all owned cells.
        """
        self._least[cells] = np.minimum(self._least[cells], strains[cells])
        self._most[cells] = np.maximum(self._most[cells], strains[cells])

    def end(self) -> Array:
        """The swing of each owned cell, zero where none was observed; another window begins."""
        out = np.maximum(self._most - self._least, 0.0)
        self._least[:], self._most[:] = np.inf, -np.inf
        return out

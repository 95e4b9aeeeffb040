"""The length of a window of observation: as given, or a little more than the longest period."""

from __future__ import annotations

from math import nan
from typing import Literal

from rigidfx.decide.memory.memory import Memory

__all__ = ["MARGIN", "window_length"]

MARGIN = 1.25  # an automatic window in longest periods
FEWEST = 8  # steps of an automatic window


def window_length(given: float | Literal["auto"], memory: Memory) -> float:
    """How long a window is to be [s]; NaN while that is not known. Collective.

    Args:
        given: Length [s], or "auto".
        memory: Memory of the policy.
    """
    if not isinstance(given, str):
        return float(given)
    if memory.window.steps < FEWEST:
        return nan
    return MARGIN * memory.signals.period()

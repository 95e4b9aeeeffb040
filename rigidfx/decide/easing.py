"""The time in which the stress of released cells fades: see `rigidfx.mechanics.eased`."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, isfinite, pi

__all__ = ["Easing"]

# A stress that fades as ½ (1 + cos πt/T) lets cells strain by ε at a rate of up to π/2 ε/T.
STEEPEST = pi / 2
# What cells would spring by is known to less than this part of it.
KNOWN = 1e-3


@dataclass(frozen=True)
class Easing:
    """Chooses the time T in which a stress fades, so slowly that it wakes no cells.

    Attributes:
        part: Least T as a part of a window; with zero no stress is kept.
    """

    part: float

    def span(self, window: float, dt: float, spring: float) -> float:
        """T [s]; zero if no stress is kept.

        Args:
            window: Length of a window [s].
            dt: Length of the step [s].
            spring: Strain rate of a sudden release in this step, over the rate that wakes cells.
        """
        if not self.part > 0 or not isfinite(window):
            return 0.0
        # In whole steps, so that what it is known by makes no difference.
        steps = ceil(STEEPEST * spring * (1 - KNOWN))
        return min(window, max(self.part * window, steps * dt))

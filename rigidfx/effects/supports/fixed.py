"""Nodes that are held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.effects.supports.support import Support

__all__ = ["Fixed"]


@dataclass(frozen=True)
class Fixed(Support):
    """Holds the nodes of a named set where they are when the window begins."""

    def displacement_at(self, t: float) -> npt.NDArray[np.float64]:
        """Zero."""
        return np.zeros(3)

    def velocity_at(self, t: float, dt: float) -> npt.NDArray[np.float64]:
        """Zero."""
        return np.zeros(3)

    def same_motion(self, other: Support) -> bool:
        """Two fixed supports never disagree."""
        return isinstance(other, Fixed)

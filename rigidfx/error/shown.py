"""The error motion as a run shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Shown"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Shown:
    """The error motion in space at an instant.

    Attributes:
        displacement: Q_p e of the owned nodes, shape (nodes, 3) [m].
        velocity: Q_p ė, likewise [m/s].
    """

    displacement: Array
    velocity: Array

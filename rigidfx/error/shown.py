"""The error motion as a run shows it."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.types import Array

__all__ = ["Shown"]


@dataclass(frozen=True)
class Shown:
    """The error motion in space at an instant.

    Attributes:
        displacement: Q_p e of the owned nodes, shape (nodes, 3) [m].
        velocity: Q_p ė, likewise [m/s].
    """

    displacement: Array
    velocity: Array

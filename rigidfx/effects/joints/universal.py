"""Universal joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import Joint, axis_of
from rigidfx.effects.joints.pieces import Pieces

__all__ = ["Universal"]

RIGHT_ANGLE = 1e-6  # cosine that two axes may have at the start


@dataclass(frozen=True)
class Universal(Joint):
    """A universal joint: both sides share a point; an axis of each stays normal to the other.

    Attributes:
        axis_a: Axis of the first side at the start, of any length.
        axis_b: Axis of the second side there, perpendicular to the first.
    """

    axis_a: Vector | None = None
    axis_b: Vector | None = None

    def __post_init__(self) -> None:
        """Check the axes.

        Raises:
            SceneError: If one has no length, or they are not perpendicular.
        """
        super().__post_init__()
        one, other = axis_of(self, self.axis_a), axis_of(self, self.axis_b)
        if abs(one @ other) > RIGHT_ANGLE:
            angle = np.degrees(np.arccos(np.clip(one @ other, -1, 1)))
            raise SceneError(
                f"{self.owner}: its axes have to be perpendicular at the start, and are at "
                f"{angle:.3g}°."
            )

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point, and axes across each other."""
        self.meet(pieces, a, b)
        one = pieces.add(a.direction(axis_of(self, self.axis_a)), 0)
        other = pieces.add(b.direction(axis_of(self, self.axis_b)), 1)
        pieces.perpendicular(one, other, "turn")

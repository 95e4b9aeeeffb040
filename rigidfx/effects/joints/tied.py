"""Ties: joints that leave nothing free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.pieces import Pieces

__all__ = ["Tied"]


@dataclass(frozen=True)
class Tied(Joint):
    """Both sides move as one: a bolted flange, or two surfaces whose meshes do not match.

    Mean faces are tied by their mean motion: each may deform by itself.
    """

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point, and three directions."""
        self.meet(pieces, a, b)
        self.align(pieces, a, b, np.eye(3)[0]).hold_angle(pieces)

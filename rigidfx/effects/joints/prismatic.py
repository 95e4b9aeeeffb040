"""Sliders."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.effects.joints.axial import Axial
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import axis_of
from rigidfx.effects.joints.pieces import Pieces

__all__ = ["Prismatic"]


@dataclass(frozen=True)
class Prismatic(Axial):
    """A slider: both sides slide along one axis, and do not turn."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """An axis, points on it, and no rotation about it."""
        points = self.points(pieces, a, b)
        aligned = self.align(pieces, a, b, axis_of(self, self.axis))
        aligned.hold_place(pieces, points)
        aligned.hold_angle(pieces)
        aligned.leave_travel(pieces, points)

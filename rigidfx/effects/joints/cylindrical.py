"""Joints that turn and slide."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.effects.joints.axial import Axial
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import axis_of
from rigidfx.effects.joints.pieces import Pieces

__all__ = ["Cylindrical"]


@dataclass(frozen=True)
class Cylindrical(Axial):
    """Both sides share an axis; they rotate about it and slide along it."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """An axis, and points on it."""
        points = self.points(pieces, a, b)
        aligned = self.align(pieces, a, b, axis_of(self, self.axis))
        aligned.hold_place(pieces, points)
        aligned.leave_angle(pieces)
        aligned.leave_travel(pieces, points)

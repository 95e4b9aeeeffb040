"""Hinges."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.effects.joints.axial import Axial
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import axis_of
from rigidfx.effects.joints.pieces import Pieces

__all__ = ["Revolute"]


@dataclass(frozen=True)
class Revolute(Axial):
    """A hinge: both sides share a point and an axis, and rotate about the axis."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point, and an axis."""
        self.meet(pieces, a, b)
        self.align(pieces, a, b, axis_of(self, self.axis)).leave_angle(pieces)

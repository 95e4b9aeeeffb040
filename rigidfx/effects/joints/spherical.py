"""Ball joints."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.effects.joints.averages import Sided
from rigidfx.effects.joints.joint import Joint
from rigidfx.effects.joints.pieces import Pieces

__all__ = ["Spherical"]


@dataclass(frozen=True)
class Spherical(Joint):
    """A ball joint: both sides share a point and rotate freely about it."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point."""
        self.meet(pieces, a, b)

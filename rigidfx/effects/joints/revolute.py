"""Hinges."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.joint import Joint, Sided, axis_of
from rigidfx.effects.joints.pieces import Pieces, perpendiculars

__all__ = ["Revolute"]


@dataclass(frozen=True)
class Revolute(Joint):
    """A hinge: both sides have one point and one axis in common, and turn about that.

    Attributes:
        axis: Direction of the axis at the start, of any length.
    """

    axis: Vector

    def __post_init__(self) -> None:
        """Check the axis.

        Raises:
            SceneError: If it has no length.
        """
        super().__post_init__()
        axis_of(self, self.axis)

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point; the axis of one side perpendicular to two directions of the other."""
        self.meet(pieces, a, b)
        axis = axis_of(self, self.axis)
        across = perpendiculars(axis)
        for one, other in ((a, b), (b, a)):
            if one.knows(axis) and all(map(other.knows, across)):
                along = pieces.add(one.direction(axis))
                for k, e in enumerate(across):
                    pieces.perpendicular(along, pieces.add(other.direction(e)), f"tilt {k + 1}")
                return
        raise SceneError(
            f"{self.owner}: the nodes of its sides lie in planes, and do not tell how both stand "
            "to the axis. One side has to be a Rigid part, the ground or a surface that is not "
            "flat, such as a hole."
        )

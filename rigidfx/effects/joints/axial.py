"""The base of joints with an axis."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.effects.base import Vector
from rigidfx.effects.joints.joint import Joint, axis_of

__all__ = ["Axial"]


@dataclass(frozen=True)
class Axial(Joint):
    """A joint that has an axis.

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

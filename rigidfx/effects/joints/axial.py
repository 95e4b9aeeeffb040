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
        axis: Direction of the axis at the start, of any length; that of the hole or shaft if None.
    """

    axis: Vector | None = None

    def __post_init__(self) -> None:
        """Check the axis.

        Raises:
            SceneError: If it has no length.
        """
        super().__post_init__()
        if self.axis is not None:
            axis_of(self, self.axis)

    @property
    def missing(self) -> tuple[str, ...]:
        """See `Joint`."""
        return (*super().missing, *(() if self.axis is not None else ("axis",)))

"""A tolerance as a part of the largest strain rate so far."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.taken import take_fields
from rigidfx.scene.step_control import fraction

__all__ = ["Relative"]


@dataclass(frozen=True)
class Relative:
    """A part of the largest strain rate that any cell has had so far.

    Nobody knows strain rates in 1/s beforehand, but two per cent of the largest means the same for
    any structure. As long as no rate has been above noise, only cells that do not strain at all
    count as rigid.

    Attributes:
        part: Between 0 and 1.
    """

    part: float

    def __post_init__(self) -> None:
        """Check the number.

        Raises:
            SceneError: If it is none between 0 and 1.
        """
        fraction("Relative", "part", self.part)
        take_fields(self)

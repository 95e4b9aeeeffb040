"""A tolerance as a part of the largest strain rate so far."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.taken import take_fields
from rigidfx.scene.step_control import fraction

__all__ = ["Relative"]


@dataclass(frozen=True)
class Relative:
    """A tolerance relative to the largest strain rate of any cell so far.

    It suits any structure, while strain rates in 1/s are rarely known in advance. Until a rate has
    exceeded the noise of Newton's method, only cells without any strain qualify.

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

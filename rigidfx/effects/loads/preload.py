"""Static equilibrium before the motion starts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown, whole
from rigidfx.effects.base import Effect
from rigidfx.effects.loads.dead_load import DeadLoad

__all__ = ["Preload"]


@dataclass(frozen=True)
class Preload(Effect):
    """Static equilibrium under loads of its own, found before the dynamics start from rest in it.

    The loads act in the statics only: one that is to stay on is named in the scene as well, one
    that is not is thereby let go suddenly at the start.

    Attributes:
        loads: Dead loads, taken at the start time.
        increments: Number of equal load increments.
    """

    loads: Sequence[DeadLoad]
    increments: int = 1

    def __post_init__(self) -> None:
        """Check the loads.

        Raises:
            SceneError: If there are none, one is not a dead load, or increments < 1.
        """
        super().__post_init__()
        given = (self.loads,) if isinstance(self.loads, DeadLoad) else self.loads
        listed = isinstance(given, Iterable) and not isinstance(given, Set)
        loads = tuple(given) if listed else ()
        if not loads or not all(isinstance(load, DeadLoad) for load in loads):
            raise SceneError(f"Preload: loads must be one or more dead loads, got {shown(given)}.")
        object.__setattr__(self, "loads", loads)
        increments = whole("Preload", "increments", self.increments, least=1)
        object.__setattr__(self, "increments", increments)

    def check(self, scene: Any) -> None:
        """Check its loads."""
        for load in self.loads:
            load.check(scene)

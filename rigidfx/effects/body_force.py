"""Dead loads per volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rigidfx.effects.base import Array, Vector
from rigidfx.effects.dead_load import DeadLoad

__all__ = ["BodyForce"]


@dataclass(frozen=True)
class BodyForce(DeadLoad):
    """Dead force per reference volume [N/m³].

    Attributes:
        value: Three components [N/m³], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector]
    where: str | None = None

    def weights(self, scene: Any) -> Array:
        """Volume of each node [m³]."""
        return scene.cell_weights(1.0, scene.owned_cells(self.where, self.kind))

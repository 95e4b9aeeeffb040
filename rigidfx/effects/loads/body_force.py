"""Dead loads per volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from rigidfx.effects.base import Array, Vector
from rigidfx.effects.fields import PlaceAndTime
from rigidfx.effects.loads.dead_load import DeadLoad

__all__ = ["BodyForce"]


@dataclass(frozen=True)
class BodyForce(DeadLoad):
    """Dead force per reference volume [N/m³].

    Attributes:
        value: Three components [N/m³], or a function t giving them, or a function x, t of
            reference positions of shape (3, n) [m] giving shape (3, n).
        where: Name of a set of cells; everywhere if None.
    """

    local: ClassVar[bool] = True

    value: Vector | PlaceAndTime
    where: str | None = None

    def weights(self, scene: Any) -> Array:
        """Volume of each node [m³]."""
        return scene.cell_weights(1.0, scene.owned_cells(self.where, self.kind))

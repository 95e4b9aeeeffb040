"""Dead loads per area."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from rigidfx.effects.base import Array, Vector
from rigidfx.effects.fields import PlaceAndTime
from rigidfx.effects.loads.dead_load import DeadLoad

__all__ = ["Traction"]


@dataclass(frozen=True)
class Traction(DeadLoad):
    """Dead traction on named facets, per reference area [Pa].

    Attributes:
        where: Name of a set of facets.
        value: Three components [Pa], or a function t giving them, or a function x, t of
            reference positions of shape (3, n) [m] giving shape (3, n).
    """

    dims: ClassVar[tuple[int, ...]] = (2,)
    local: ClassVar[bool] = True

    where: str
    value: Vector | PlaceAndTime

    def weights(self, scene: Any) -> Array:
        """Area of each node [m²]."""
        return scene.facet_weights(self.where, self.kind)

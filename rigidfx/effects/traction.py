"""Dead loads per area."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from rigidfx.effects.base import Array, Vector
from rigidfx.effects.dead_load import DeadLoad

__all__ = ["Traction"]


@dataclass(frozen=True)
class Traction(DeadLoad):
    """Dead traction on named facets, per reference area [Pa].

    Attributes:
        where: Name of a set of facets.
        value: Three components [Pa], or a function of time giving them.
    """

    dims: ClassVar[tuple[int, ...]] = (2,)

    where: str
    value: Vector | Callable[[float], Vector]

    def weights(self, scene: Any) -> Array:
        """Area of each node [m²]."""
        return scene.facet_weights(self.where, self.kind)

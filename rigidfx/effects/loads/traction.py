"""Dead loads on surfaces, per area or in all."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
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
        total: Whether values are the total force [N], spread evenly over the area; for a function
            of place its mean is the resultant.
    """

    dims: ClassVar[tuple[int, ...]] = (2,)
    local: ClassVar[bool] = True

    where: str
    value: Vector | PlaceAndTime
    total: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            SceneError: If one cannot be used.
        """
        super().__post_init__()
        if not isinstance(self.total, bool):
            raise SceneError(
                f"{self.owner}: total must be True or False, got {shown(self.total)}; the force "
                "itself is its value."
            )

    def weights(self, scene: Any) -> Array:
        """Area of each node [m²], or its part of the whole area [1]."""
        areas = scene.facet_weights(self.where, self.kind)
        return areas / scene.sum(areas[: scene.owned_nodes].sum()) if self.total else areas

"""Dead loads per volume, per area, and on nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.effects.base import Vector
from rigidfx.effects.fields import PlaceAndTime
from rigidfx.effects.loads.dead_load import DeadLoad

__all__ = ["BodyForce", "NodalForce", "Traction"]


@dataclass(frozen=True)
class BodyForce(DeadLoad):
    """Dead force per reference volume [N/m³].

    It acts on volumes. It neglects each `PointMass` and the given mass of a `Rigid` part, and warns
    of them. Weight is `Gravity`.

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

    def check(self, scene: Any) -> None:
        """Check set and function; warn of masses that it passes by. Collective."""
        super().check(scene)
        n = scene.owned_nodes
        loaded = self.weights(scene)[:n] != 0.0
        passed = scene.sum(scene.point_masses[:n][loaded].sum())
        cells = scene.owned_cells(self.where, self.kind)
        for rigid in (e for e in scene.effects if e.is_rigid and e.given and e.mass is not None):
            shared = np.intersect1d(cells, scene.owned_cells(rigid.where, self.kind)).size
            passed += float(rigid.mass) if scene.sum(shared) > 0 else 0.0
        if passed > 0:
            warn(
                scene.comm,
                f"{self.owner}: a force per volume does not act on {passed:.6g} kg of point masses "
                "and of Rigid parts of given mass at its nodes. If it is meant as weight, take "
                "Gravity, which acts on all mass.",
            )


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
        """Raise `SceneError` if a value cannot be used."""
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


@dataclass(frozen=True)
class NodalForce(DeadLoad):
    """A total force spread in equal parts over the nodes of a named set.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        value: Three components of the *total* force [N], or a function of time giving them.
    """

    dims: ClassVar[tuple[int, ...]] = (2, 3, 1, 0)

    where: str
    value: Vector | Callable[[float], Vector]

    def weights(self, scene: Any) -> Array:
        """Share of each node [1]."""
        return scene.shares(self.where, self.kind)

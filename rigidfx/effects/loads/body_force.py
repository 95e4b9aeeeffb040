"""Dead loads per volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.warning import warn
from rigidfx.effects.base import Array, Vector
from rigidfx.effects.fields import PlaceAndTime
from rigidfx.effects.loads.dead_load import DeadLoad

__all__ = ["BodyForce"]


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

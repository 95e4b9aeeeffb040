"""A uniform acceleration field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.effects.action import Structure
from rigidfx.effects.base import Array, Vector
from rigidfx.effects.loads.dead_load import DeadLoad
from rigidfx.mechanics.rigid_body import RigidBody

__all__ = ["Gravity"]


@dataclass(frozen=True)
class Gravity(DeadLoad):
    """Uniform acceleration field: force ρ0 g per reference volume.

    Attributes:
        value: Acceleration g, three components [m/s²], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector] = (0.0, 0.0, -9.81)
    where: str | None = None

    def weights(self, scene: Any) -> Array:
        """Mass of each node, and point masses where it acts everywhere [kg]."""
        weights = scene.cell_weights(scene.density(), scene.owned_cells(self.where, self.kind))
        return weights if self.where is not None else weights + scene.point_masses

    def moments(self, structure: Structure, weights: Array) -> Array:
        """As of any dead load, but bodies whose mass is given weigh what that says."""
        out = super().moments(structure, weights)
        for k, body in enumerate(structure.bodies.of.records):
            if body.given:
                out[k] = self._given(structure.scene, body)
        return out

    def _given(self, scene: Any, body: RigidBody) -> Array:
        """Σ w and Σ w V of a body whose mass is given, shape (4,) [kg, kg m]. Collective.

        The loaded fraction of its cells' weight, scaled to the given mass, acts at the centre of
        mass. It stands for all lumped mass on its nodes; of a consistent one what flexible cells
        have there comes on top.
        """
        where, own = scene.owned_cells(self.where, self.kind), body.cells
        beside = np.setdiff1d(where, own) if scene.mass == "consistent" else own[:0]
        parts = own, np.intersect1d(where, own), beside
        sums = []
        for cells in parts:
            w = scene.cell_weights(scene.density(), cells)[: scene.owned_nodes]
            sums.append(np.r_[w[body.nodes].sum(), w[body.nodes] @ body.offsets])
        whole, acting, others = np.asarray(scene.sum(np.stack(sums)))
        share = acting[0] / whole[0]
        coordinates = (acting - share * whole) / whole[0]
        coordinates[0] = share
        return np.asarray(body.mass * coordinates + others)

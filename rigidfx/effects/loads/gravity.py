"""A uniform acceleration field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.effects.action import Structure
from rigidfx.effects.attached.point_mass import PointMass
from rigidfx.effects.base import Vector
from rigidfx.effects.loads.dead_load import DeadLoad
from rigidfx.mechanics.rigid_body import RigidBody

__all__ = ["Gravity"]


@dataclass(frozen=True)
class Gravity(DeadLoad):
    """Uniform acceleration field: force m g on all mass of the nodes it acts on.

    The force of cells is ρ0 g per reference volume. Each `PointMass` on nodes of these cells has
    its weight, too, and a `Rigid` part of given mass has the weight of that mass.

    Attributes:
        value: Acceleration g, three components [m/s²], or a function of time giving them.
        where: Name of a set of cells; everywhere if None.
    """

    value: Vector | Callable[[float], Vector] = (0.0, 0.0, -9.81)
    where: str | None = None

    def weights(self, scene: Any) -> Array:
        """Mass of the loaded cells at each node, and its point masses [kg]. Collective."""
        weights = scene.cell_weights(scene.density(), scene.owned_cells(self.where, self.kind))
        return weights + scene.point_masses * self._members(scene) + self._at_faces(scene)

    def _at_faces(self, scene: Any) -> Array | float:
        """Masses at points of faces, by the weights of the nodes that move them. Collective."""
        out = np.zeros(len(scene.point_masses))
        for effect in (e for e in scene.named(PointMass) if e.face is not None):
            place = effect.remote.place
            if not effect.is_carried and self._acts_on(scene, effect):
                out[place.nodes] += float(effect.mass) * place.weights
        return out

    def _acts_on(self, scene: Any, effect: PointMass) -> bool:
        """Whether all nodes of the face of a mass are in its cells. Collective."""
        inside = np.broadcast_to(self._members(scene), len(scene.point_masses))
        missing = np.count_nonzero(inside[effect.remote.place.nodes] == 0.0)
        return bool(scene.sum(missing) == 0)

    def _members(self, scene: Any) -> Array | float:
        """1 at the nodes of its cells, 0 elsewhere, per local node. Collective."""
        return 1.0 if self.where is None else scene.members(self.where, self.kind)[:, 0]

    def check(self, scene: Any) -> None:
        """Check its set, and that no other one loads the same point mass too. Collective."""
        super().check(scene)
        others = [e for e in scene.named(Gravity) if e.where not in (None, self.where)]
        for other in others if self.where is not None else ():
            both = scene.point_masses * self._members(scene) * other._members(scene)
            if scene.sum(both[: scene.owned_nodes].sum()) > 0:
                raise SceneError(
                    f"Gravity: '{self.where}' and '{other.where}' both hold nodes of a PointMass, "
                    "which would weigh twice. Name one set that holds all of them."
                )

    def moments(self, structure: Structure, weights: Array) -> Array:
        """As of any dead load, but bodies whose mass is given weigh that mass."""
        once = structure.once
        out = super().moments(structure, weights)
        carried = {e.title: e for e in structure.scene.named(PointMass) if e.is_carried}
        for k, body in enumerate(structure.bodies.of.records):
            if body.name in carried:
                acts = self._acts_on(structure.scene, carried[body.name])
                out[k, 0] = once * body.mass if acts else 0
            elif body.given:
                given = once * self._given(structure.scene, body)
                out[k, : given.size] = given
        return out

    def _given(self, scene: Any, body: RigidBody) -> Array:
        """Σ w a of a body whose mass is given, shape (n,) [kg, kg m]. Collective.

        The loaded fraction of its cells' weight, scaled to the given mass, acts at the centre of
        mass. It stands for all lumped mass on its nodes; with a consistent one the mass of flexible
        cells there comes on top.
        """
        where, own = scene.owned_cells(self.where, self.kind), body.cells
        beside = np.setdiff1d(where, own) if scene.mass == "consistent" else own[:0]
        parts = own, np.intersect1d(where, own), beside
        sums = []
        for cells in parts:
            w = scene.cell_weights(scene.density(), cells)[: scene.owned_nodes]
            sums.append(w[body.nodes] @ body.coordinates())
        whole, acting, others = np.asarray(scene.sum(np.stack(sums)))
        share = acting[0] / whole[0]
        coordinates = (acting - share * whole) / whole[0]
        coordinates[0] = share
        return np.asarray(body.mass * coordinates + others)

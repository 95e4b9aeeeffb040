"""Masses without size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rigidfx.base.inputs import positive
from rigidfx.effects.base import Array, Effect

__all__ = ["PointMass"]


@dataclass(frozen=True)
class PointMass(Effect):
    """A mass without size, spread in equal parts over the nodes of a named set.

    It counts in inertia and momenta, in the mass and inertia of a body that holds its nodes, and in
    `Gravity` everywhere or on a set that holds its nodes.

    Attributes:
        where: Name of a set of any dimension; all nodes in its closure take part.
        mass: *Total* mass > 0 [kg].
    """

    where: str
    mass: float

    def __post_init__(self) -> None:
        """Check the mass.

        Raises:
            SceneError: If it is not a finite number > 0.
        """
        super().__post_init__()
        positive("PointMass", "mass", self.mass)

    def nodal_mass(self, scene: Any) -> Array:
        """Mass of each local node, ghosts included, shape (nodes,) [kg]. Collective."""
        return float(self.mass) * scene.shares(self.where, self.kind)

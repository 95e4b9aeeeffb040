"""Centrifugal forces of a static equilibrium in a frame that turns.

In a frame that turns with ω about c, statics have the load

    f = -M ω × (ω × (x - c)) = M S (x - c),   S = |ω|² I - ω ωᵀ.

It follows the deformed place x = X + u, so that its stiffness is -M S.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import Effect, Vector

__all__ = ["Centrifugal"]


@dataclass(frozen=True)
class Centrifugal(Effect):
    """Centrifugal forces on nodes, by the scene's mass operator; of statics only.

    Attributes:
        spin: Angular velocity ω [rad/s].
        centre: Point of the axis, c [m].
        share: Tells the part of the forces that acts, in increments of a load.
    """

    spin: Vector
    centre: Vector
    share: Callable[[], float]

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes."""
        return CentrifugalForces(self, structure)


class CentrifugalForces(Action):
    """M S (x - c) on the nodes of a division without bodies."""

    kind = "Preload"

    def __init__(self, load: Centrifugal, structure: Structure) -> None:
        """Take mass and places over.

        Args:
            load: The effect.
            structure: Its nodes and bodies.
        """
        spin, rows = np.asarray(load.spin, dtype=np.float64), structure.rows
        self._S, self._share = spin @ spin * np.eye(3) - np.outer(spin, spin), load.share
        self._mass, self._u0, self._dofs = structure.mass, structure.u, rows.dofs
        self._arms = (rows.X - np.asarray(load.centre)).reshape(-1)
        self._own = np.flatnonzero(structure.own)
        self._nodes = rows.nodes[self._own]
        # The softening of a consistent mass is taken by its row sums: iterations see it, the
        # solution does not.
        own_mass = structure.scene.nodal_mass[self._nodes]
        self._softening = -own_mass[:, None, None] * self._S
        self._place, self._image = rows.vector(), rows.vector()
        mass = structure.scene.sum(own_mass.sum())
        largest = np.abs(self._arms).max(initial=0.0)
        self.rounding = (
            float(np.linalg.norm(self._S)) * mass * structure.scene.comm.allreduce(largest)
        )

    def resist_nodes(self, d: Any, dt: float, f: Any) -> None:
        """Subtract M S (x - c)."""
        arms = self._arms + self._u0[self._dofs] + d.array_r
        self._place.array[:] = (arms.reshape(-1, 3) @ self._S).reshape(-1)
        self._mass.mult(self._place, self._image)
        f.axpy(-self._share(), self._image)

    def stiffen_nodes(self, tangent: Any, dt: float, prolongation: Any) -> None:
        """Subtract M S, by row sums."""
        tangent.add_nodal(self._nodes, self._share() * self._softening)

    def destroy(self) -> None:
        """Free the work vectors. Collective."""
        self._place.destroy()
        self._image.destroy()

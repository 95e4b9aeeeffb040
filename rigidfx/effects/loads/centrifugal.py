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

from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.attached.grounded import Grounded, GroundedBodies
from rigidfx.effects.base import Effect, Vector
from rigidfx.effects.damping.mass_damping import euler
from rigidfx.mechanics.body_step import Increments

__all__ = ["Centrifugal"]


@dataclass(frozen=True)
class Centrifugal(Effect):
    """Centrifugal forces on nodes, by the scene's mass operator, and on bodies; of statics only.

    Attributes:
        spin: Angular velocity ω [rad/s].
        centre: Point of the axis, c [m].
        share: Tells the part of the forces that acts, in increments of a load.
    """

    spin: Vector | Array
    centre: Vector | Array
    share: Callable[[], float]

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes and bodies, with their derivatives."""
        return SofteningForces(self, structure)


class CentrifugalForces(Grounded):
    """M S (x - c) on nodes, and on bodies, whose part of the stiffness it has."""

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
        self._place, self._image = rows.vector(), rows.vector()
        bodies = structure.bodies
        axis = np.zeros((len(bodies), 4, 3))
        axis[:, 0] = load.centre
        spread = np.reshape([euler(body) for body in bodies.of.records], (-1, 4, 4))
        none = np.zeros((3, 3))
        self._bodies = GroundedBodies(spread, axis, 0 * axis, 0.0, -self._S, none, False, 1.0)
        self._nodes = rows.nodes[np.flatnonzero(structure.own)]
        self._own_mass = structure.scene.nodal_mass[self._nodes]
        mass = structure.scene.sum(self._own_mass.sum())
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

    def resist_bodies(self, increments: Increments) -> Array:
        """See `Action`."""
        return self._share() * super().resist_bodies(increments)

    def stiffen_bodies(self, increments: Increments) -> Array:
        """See `Action`."""
        return self._share() * super().stiffen_bodies(increments)

    def destroy(self) -> None:
        """Free the work vectors. Collective."""
        self._place.destroy()
        self._image.destroy()


class SofteningForces(CentrifugalForces):
    """With the stiffness of nodes."""

    def stiffen_nodes(self, tangent: Any, dt: float, prolongation: Any) -> None:
        """Subtract M S; of a consistent mass by row sums: iterations see it, the solution not."""
        softening = -self._own_mass[:, None, None] * self._S
        tangent.add_nodal(self._nodes, self._share() * softening)

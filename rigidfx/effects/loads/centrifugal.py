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
from rigidfx.effects.base import Effect, Vector
from rigidfx.effects.inertia import Inertia
from rigidfx.effects.motion import Motion, Tangent

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


class CentrifugalForces(Action):
    """M S (x - c) on nodes, and on bodies, whose part of the stiffness it has."""

    kind = "Preload"

    def __init__(self, load: Centrifugal, structure: Structure) -> None:
        """Take mass and places over. Collective.

        Args:
            load: The effect.
            structure: Its nodes and bodies.
        """
        spin, rows = np.asarray(load.spin, dtype=np.float64), structure.rows
        self._S, self._share = spin @ spin * np.eye(3) - np.outer(spin, spin), load.share
        self._u0, self._dofs = structure.u, rows.dofs
        self._inertia, self._arms = Inertia(structure), rows.X - np.asarray(load.centre)
        self._axis = np.zeros_like(structure.bodies.pose)
        self._axis[:, 0] = load.centre
        self._nodes = rows.nodes[np.flatnonzero(structure.own)]
        self._own_mass = structure.scene.nodal_mass[self._nodes]
        mass = structure.scene.sum(self._own_mass.sum())
        largest = structure.scene.comm.allreduce(np.abs(self._arms).max(initial=0.0))
        self.rounding = float(np.linalg.norm(self._S)) * mass * largest

    def resist(self, motion: Motion, forces: Any) -> None:
        """Subtract M S (x - c)."""
        inertia, increments = self._inertia, motion.increments
        arms = self._arms + self._u0[self._dofs].reshape(-1, 3) + motion.nodes
        inertia.field.array[:] = (arms @ self._S).reshape(-1)
        places = increments.start.pose + increments.displacement - self._axis
        inertia.add(-self._share(), inertia.field, places @ self._S, forces)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """See `Action`; of bodies only."""
        tangent.add_spread(self._inertia.spread, -self._share() * self._S)

    def destroy(self) -> None:
        """Free the work vectors. Collective."""
        self._inertia.destroy()


class SofteningForces(CentrifugalForces):
    """With the stiffness of nodes."""

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Subtract M S; of a consistent mass by row sums: iterations see it, the solution not."""
        super().stiffen(motion, tangent)
        softening = -self._own_mass[:, None, None] * self._S
        tangent.matrix.add_nodal(self._nodes, self._share() * softening)

"""A drag on the increments of a load step, which makes statics of loose parts regular.

The force -s M (x - x*) draws nodes and bodies to places x* near an equilibrium. Where these follow
the solution it vanishes, and with x* = x the equilibrium is that without it: a proximal point
method (R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877). Each solve is an implicit Euler
step of length s^(-1/2) from rest, so that it leads to stable equilibria.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.attached.grounded import GroundedBodies
from rigidfx.effects.base import Effect
from rigidfx.effects.damping.mass_damping import euler
from rigidfx.mechanics.body_step import Increments

__all__ = ["StepDrag", "StepDragForces"]


@dataclass(frozen=True)
class StepDrag(Effect):
    """The drag; of statics only.

    Attributes:
        tell: Called with the forces when they are bound.
    """

    tell: Callable[[StepDragForces], None]

    def bind(self, structure: Structure) -> Action:
        """The forces on nodes and bodies."""
        forces = StepDragForces(structure)
        self.tell(forces)
        return forces


class StepDragForces(Action):
    """s M (x - x*) as a resistance.

    Attributes:
        rate: s [1/s²].
    """

    kind = StepDrag.__name__

    def __init__(self, structure: Structure) -> None:
        """Take the mass over.

        Args:
            structure: Its nodes and bodies.
        """
        self.rate, self._mass = 1.0, structure.mass
        self._moved, self._image = structure.rows.vector(), structure.rows.vector()
        bodies = structure.bodies
        spread = np.reshape([euler(body) for body in bodies.of.records], (-1, 4, 4))
        none, no = np.zeros((len(bodies), 4, 3)), np.zeros((3, 3))
        self._centre: Array = np.zeros(self._moved.local_size)
        self._bodies = GroundedBodies(spread, bodies.pose, none, 0.0, np.eye(3), no, False, 1.0)

    def draw_to(self, d: Array, pose: Array) -> None:
        """Set x*.

        Args:
            d: Increments of the nodes of the rows since the start of the step [m].
            pose: Rows r and Rᵀ of the bodies, shape (bodies, 4, 3) [m, 1].
        """
        self._centre, self._bodies = d, replace(self._bodies, pose=pose)

    def resist_nodes(self, d: Any, dt: float, f: Any) -> None:
        """Add s M (x - x*)."""
        self._moved.array[:] = d.array_r - self._centre
        self._mass.mult(self._moved, self._image)
        f.axpy(self.rate, self._image)

    def stiffen_nodes(self, tangent: Any, dt: float, prolongation: Any) -> None:
        """Add s M."""
        self._mass.add_to(tangent, self.rate, prolongation)

    def resist_bodies(self, increments: Increments) -> Array:
        """See `Action`."""
        return self.rate * self._bodies.moments(increments)

    def stiffen_bodies(self, increments: Increments) -> Array:
        """See `Action`."""
        return self.rate * self._bodies.tangent(increments)

    def destroy(self) -> None:
        """Free the work vectors. Collective."""
        self._moved.destroy()
        self._image.destroy()

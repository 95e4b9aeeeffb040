"""A drag on the increments of a load step, which makes statics of loose parts regular.

The force -s M (x - x*) draws nodes and bodies to places x* near an equilibrium. Where these follow
the solution it vanishes, and with x* = x the equilibrium is that without it: a proximal point
method (R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877). Each solve is an implicit Euler
step of length s^(-1/2) from rest, so that it leads to stable equilibria.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.effects.action import Action, Array, Structure
from rigidfx.effects.base import Effect
from rigidfx.effects.inertia import Inertia
from rigidfx.effects.motion import Motion, Tangent

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
        """Take the mass over. Collective.

        Args:
            structure: Its nodes and bodies.
        """
        self.rate, self._inertia = 1.0, Inertia(structure)
        self._pose = structure.bodies.pose
        self._centre: Array = np.zeros(self._inertia.field.local_size)

    def draw_to(self, d: Array, pose: Array) -> None:
        """Set x*.

        Args:
            d: Increments of the nodes of the rows since the start of the step [m].
            pose: Matrices of the places of bodies, shape (bodies, n, 3) [m, 1].
        """
        self._centre, self._pose = d, pose

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add s M (x - x*)."""
        inertia, increments = self._inertia, motion.increments
        inertia.field.array[:] = motion.array_r - self._centre
        apart = increments.start.pose - self._pose + increments.displacement
        inertia.add(self.rate, inertia.field, apart, forces)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add s M."""
        self._inertia.stiffen(self.rate, tangent)

    def destroy(self) -> None:
        """Free the work vectors. Collective."""
        self._inertia.destroy()

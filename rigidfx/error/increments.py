"""Increments of nodes in an attempt at a step: of those in bodies, and of the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigidfx.base.types import Array
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt

__all__ = ["increments_of"]


def increments_of(stepper: Stepper, attempt: Attempt) -> Array:
    """Increments of the owned nodes in an attempt, shape (nodes, 3) [m].

    Args:
        stepper: Has made the attempt, and none since.
        attempt: The attempt.
    """
    system = stepper.system
    layout, equilibrium = system.layout, system.equilibrium
    out: Array = np.zeros((stepper.scene.owned_nodes, 3))
    out[layout.rows.nodes] = equilibrium.d.array_r.reshape(-1, 3)
    moves: Any = attempt.increments.displacement
    for body, matrix in zip(layout.bodies, moves, strict=True):
        out[body.nodes] = matrix[0] + body.offsets @ matrix[1:]
    return out

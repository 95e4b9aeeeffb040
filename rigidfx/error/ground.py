"""Springs and dashpots between nodes and the ground, as blocks at the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.rows import Rows
from rigidfx.effects import Spring
from rigidfx.scene.scene import Scene

__all__ = ["Ground", "ground_of"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Ground:
    """Ties of nodes to the ground.

    Attributes:
        K: Stiffness, shape (nodes, 3, 3) [N/m].
        C: Damping, of the same shape [N s/m].
    """

    K: Array
    C: Array


def ground_of(scene: Scene, rows: Rows) -> Ground | None:
    """The springs of a scene at the nodes of some rows; None if it has none. Collective."""
    springs = [spring for spring in scene.named(Spring) if spring.face is None]
    if not springs:
        return None
    K, C = np.zeros((2, rows.nodes.size, 3, 3))
    for spring in springs:
        weights = scene.shares(spring.where, spring.kind)[rows.nodes, None, None]
        K += weights * spring.K
        C += weights * spring.C
    return Ground(K, C)

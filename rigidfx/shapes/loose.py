"""Rigid motions of the connected parts of a structure, and those that no support prevents."""

from __future__ import annotations

import numpy as np

from rigidfx.base.types import Array
from rigidfx.scene.points import parts_of_nodes
from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.stiffness import Stiffness
from rigidfx.step.system.rigid_motion import FREE, every_motion

# Internal forces over K's diagonal and the extent of the structure: rounding.
ROUNDING = 1e3 * float(np.finfo(np.float64).eps)


class Motions:
    """Rigid motions of the connected parts of a structure.

    Attributes:
        part: Connected part of each owned node.
        all: Six of each part, shape (owned nodes, 3, 6 · parts).
        loose: Those that no support prevents, shape (owned nodes, 3, n).
        internal: Internal forces of the state, zero if they are rounding, shape (owned nodes, 3).
    """

    def __init__(self, stiffness: Stiffness) -> None:
        """Find them. Collective."""
        scene = stiffness.scene
        parts, n = scene.parts, scene.owned_nodes
        self.part = part = parts_of_nodes(scene)[:n]
        self._sizes = np.linalg.norm(parts.upper - parts.lower, axis=1)
        self.all: Array = every_motion(stiffness.places, part, parts, np.arange(n))
        diagonal = stiffness.matrix.getDiagonal()
        rounding = ROUNDING * float(diagonal.norm()) * float(self._sizes.max())
        diagonal.destroy()
        self.internal: Array = stiffness.internal_forces(stiffness.cells)
        if not scene.sum((self.internal**2).sum()) > rounding**2:
            self.internal[:] = 0.0
        on_held = columns(self.all)[stiffness.held]
        values, vectors = np.linalg.eigh(scene.sum(on_held.T @ on_held))
        self.loose: Array = self.all @ vectors[:, values <= FREE * max(float(values[-1]), 1.0)]
        columns(self.loose)[stiffness.held] = 0.0

    def spins(self, c: Array) -> Array:
        """Angular velocity of each owned node's part, (owned nodes, 3, k) [rad/s], by motions."""
        turns = c.reshape(self._sizes.size, 6, c.shape[1])[:, 3:] / self._sizes[:, None, None]
        return np.asarray(turns[self.part])

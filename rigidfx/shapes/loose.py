"""Rigid motions of connected parts: those that nothing prevents, or springs alone."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.shapes.orthonormal import columns
from rigidfx.shapes.stiffness import Stiffness, times
from rigidfx.step.system.rigid_motion import FREE, rigid_motions

__all__ = ["Motions"]

Array = npt.NDArray[np.float64]

# Stiffness of springs against a motion, or internal forces, over those of K's diagonal: rounding.
ROUNDING = 1e3 * float(np.finfo(np.float64).eps)


class Motions:
    """Rigid motions of the connected parts of a structure.

    Attributes:
        part: Connected part of each owned node.
        all: Six of each part, shape (owned nodes, 3, 6 · parts).
        loose: Those that nothing prevents, shape (owned nodes, 3, n).
        internal: Internal forces of the state, zero if they are rounding, shape (owned nodes, 3).
        swings: Those that springs alone resist, shape (owned nodes, 3, n).
        resisted: K times these, without rounding of the cells' part, shape (owned unknowns, n).
    """

    def __init__(self, stiffness: Stiffness) -> None:
        """Find them. Collective.

        Args:
            stiffness: The stiffness.
        """
        scene = stiffness.scene
        parts, n, of_node = (
            scene.parts,
            scene.owned_nodes,
            np.zeros(scene.nodal_mass.size, np.int64),
        )
        of_node[scene.space.dofmap.list] = parts.of_cell[:, None]
        self.part = part = of_node[:n]
        self._sizes = np.linalg.norm(parts.upper - parts.lower, axis=1)
        every = np.zeros((n, 3, parts.count, 6))
        every[np.arange(n), :, part] = rigid_motions(stiffness.places, part, parts)
        self.all: Array = every.reshape(n, 3, 6 * parts.count)
        diagonal = stiffness.matrix(springs=False).getDiagonal()
        rounding = ROUNDING * float(diagonal.norm()) * float(self._sizes.max())
        self.internal: Array = stiffness.internal_forces(stiffness.cells)
        if not scene.sum((self.internal**2).sum()) > rounding**2:
            self.internal[:] = 0.0
        on_held = columns(self.all)[stiffness.held]
        values, vectors = np.linalg.eigh(scene.sum(on_held.T @ on_held))
        c = vectors[:, values <= FREE * max(float(values[-1]), 1.0)]
        y = stiffness.unknowns_of(self._moved(stiffness, c))
        K = stiffness.matrix(cells=False)
        image = times(K, y, stiffness.prolongation.unknowns)
        stiff = np.asarray(scene.sum(y.T @ image))
        sizes = np.asarray(scene.sum(np.abs(diagonal.array_r) @ y**2))
        diagonal.destroy()
        values, vectors = np.linalg.eigh(0.5 * (stiff + stiff.T))
        free = values <= ROUNDING * float(sizes.max(initial=0.0))
        self.loose: Array = self._moved(stiffness, c @ vectors[:, free])
        held = c @ vectors[:, ~free]
        self.swings: Array = self._moved(stiffness, held)
        turned = np.cross(self.spins(held), self.internal[:, :, None], axis=1)  # as the state turns
        self.resisted: Array = image @ vectors[:, ~free] + stiffness.on_unknowns(turned)

    def _moved(self, stiffness: Stiffness, c: Array) -> Array:
        """Combinations of all motions, exactly zero where they are held."""
        out = np.asarray(self.all @ c)
        columns(out)[stiffness.held] = 0.0
        return out

    def spins(self, c: Array) -> Array:
        """Angular velocity of each owned node's part, shape (owned nodes, 3, k) [rad/s].

        Args:
            c: Coefficients of all motions, shape (6 · parts, k).
        """
        turns = c.reshape(self._sizes.size, 6, c.shape[1])[:, 3:] / self._sizes[:, None, None]
        return np.asarray(turns[self.part])

"""Values of e at supports, and directions in space against the frames of parts.

A support along some axes holds u + e along these, so with the rotation Q of the part

    (Q e)ₕ = g ,     eₕ = Qₕₕ⁻¹ (g - Qₕf e_f) ,

h the held axes of a node, f its others. g is not zero where supports began while e was not. Each
step moves eₕ there, with e_f as it goes on by its rate. The frame of e has the directions of such
supports, and of springs of unlike stiffnesses, as they are in its shape. Where a part turns them by
more than `validity.SMALL`, the present places become the shape.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_DOFS, ON_NODES, Remembered
from rigidfx.base.types import Array, Bools
from rigidfx.effects import Spring
from rigidfx.error.frames import Frames
from rigidfx.error.validity import SMALL
from rigidfx.scene.scene import Scene

__all__ = ["Held"]


class Held:
    """The dofs that supports hold in e.

    Attributes:
        mask: Which of the owned dofs, shape (3 nodes,).
        values: g at them, in space, zero elsewhere, shape (nodes, 3) [m].
        moves: Whether steps move e there.
    """

    remembered: ClassVar[Remembered] = {"mask": ON_DOFS, "values": ON_NODES}

    def __init__(self, scene: Scene) -> None:
        """Hold nothing.

        Args:
            scene: The problem.
        """
        self._scene = scene
        n = scene.owned_nodes
        self.mask: Bools = np.zeros(3 * n, dtype=bool)
        self.values: Array = np.zeros((n, 3))
        self._directed: list[tuple[int, Array]] = []  # tensors, and numbers of their parts
        self.moves = False

    def hold(self, mask: Bools, e: Array, frames: Frames) -> None:
        """Hold other dofs from now on, where e has not been held as it is. Collective.

        Args:
            mask: Which.
            e: In space, shape (nodes, 3) [m].
            frames: Parts of the nodes.
        """
        new = (mask & ~self.mask).reshape(e.shape)
        self.values = np.where(mask.reshape(e.shape), np.where(new, e, self.values), 0.0)
        self.mask = mask.copy()
        self.look(frames)

    def look(self, frames: Frames) -> None:
        """Find the directions. Collective."""
        scene, count = self._scene, self._scene.parts.count
        table: Array = np.zeros((count, 8))
        np.add.at(table, (frames.part, self.mask.reshape(-1, 3) @ [1, 2, 4]), 1.0)
        found = np.argwhere(scene.sum(table)[:, 1:7])
        self._directed = [(k, np.diag(np.array(_axes(1 + kind), float))) for k, kind in found]
        for spring in scene.named(Spring):
            where = spring.where if spring.face is None else spring.face.where
            nodes = scene.nodes(where, spring.owner)
            own = frames.part[nodes[nodes < scene.owned_nodes]]
            on = np.flatnonzero(scene.sum(np.bincount(own, minlength=count).astype(float)))
            for T in (spring.K, spring.C):
                size = np.abs(T).max()
                if size > 0 and np.ptp(np.linalg.eigvalsh(T)) > SMALL * size:
                    self._directed += [(k, T / size) for k in on]
        self.moves = bool(self._directed) or bool(scene.sum(float(np.abs(self.values).sum())))

    def turned(self, Q: Array) -> bool:
        """Whether parts have turned directions too far.

        Args:
            Q: Rotation of each part from the shape, shape (parts, 3, 3).
        """
        return any(np.abs(Q[k].T @ T @ Q[k] - T).max() > SMALL for k, T in self._directed)

    @property
    def directed(self) -> bool:
        """Whether there are such directions."""
        return bool(self._directed)

    def increments(self, e: Array, rate: Array, dt: float, turned: Array) -> Array:
        """Increments of e at the held dofs in a step, zero elsewhere, shape (nodes, 3) [m].

        Args:
            e: At its start, in the frame, likewise.
            rate: Of e, likewise [m/s].
            dt: Length of the step [s].
            turned: Rotation of each owned node's part at its end, shape (nodes, 3, 3).
        """
        out, kinds = np.zeros_like(e), self.mask.reshape(-1, 3) @ [1, 2, 4]
        for kind in range(1, 8):
            at = np.flatnonzero(kinds == kind)
            h, f = (np.flatnonzero(np.equal(_axes(kind), on)) for on in (True, False))
            Q, free = turned[at][:, h], (e + dt * rate)[at][:, f]
            given = self.values[at][:, h] - np.einsum("nij,nj->ni", Q[:, :, f], free)
            found = np.linalg.solve(Q[:, :, h], given[:, :, None])[:, :, 0]
            out[at[:, None], h] = found - e[at[:, None], h]
        return out


def _axes(kind: int) -> list[bool]:
    """Held axes of a kind of node, by its binary digits."""
    return [bool(kind >> k & 1) for k in range(3)]

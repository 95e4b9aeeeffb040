"""Frames of sets of nodes: the rotations that take a shape best to where the nodes lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from mpi4py import MPI

from rigidfx.base.mesh_order import MeshOrder
from rigidfx.base.remembered import ON_NODES, Kind
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.mechanics.local_rotations import LocalRotations
from rigidfx.mechanics.rotation import nearest_rotations
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["FRAMES", "Frames", "to_shape", "to_space"]

Nodes = npt.NDArray[np.integer]


class Frames:
    """Best rotations against one shape (W. Kabsch, Acta Cryst. A 32 (1976) 922-923).

    Attributes:
        shape: Places of the owned nodes in the shape, shape (nodes, 3) [m].
        part: Connected part of each owned node.
    """

    def __init__(self, scene: Scene, shape: Array) -> None:
        """Keep the shape.

        Args:
            scene: The problem.
            shape: Places of the owned nodes, shape (nodes, 3) [m].
        """
        self._scene, self.shape = scene, shape.copy()
        self.part = parts_of_nodes(scene)[: scene.owned_nodes]
        self._parts = [np.flatnonzero(self.part == k) for k in range(scene.parts.count)]
        self._rotations: tuple[int, Array] | None = None  # changes of a state, and rotations then

    def begin_at(self, x: Array) -> None:
        """Set another shape: places of the owned nodes, shape (nodes, 3) [m]."""
        self.shape, self._rotations = x.copy(), None

    def of_sets(self, sets: Sequence[Nodes], x: Array) -> Array:
        """Rotation of each set of owned nodes from the shape to where they lie. Collective.

        Args:
            sets: Owned nodes of each set; the same number of sets on all ranks.
            x: Places of the owned nodes, shape (nodes, 3) [m].

        Returns:
            Rotations, shape (sets, 3, 3).
        """
        local = np.zeros((len(sets), 1 + 3 + 3 + 9))
        for sums, nodes in zip(local, sets, strict=True):
            a, b = self.shape[nodes], x[nodes]
            sums[:] = [len(a), *a.sum(axis=0), *b.sum(axis=0), *(b.T @ a).reshape(-1)]
        if not len(sets):
            return np.zeros((0, 3, 3))
        sums = np.asarray(self._scene.sum(local))
        common = sums[:, 4:7, None] * sums[:, None, 1:4] / np.maximum(sums[:, :1, None], 1.0)
        return nearest_rotations(sums[:, 7:].reshape(-1, 3, 3) - common)

    def of_parts(self, x: Array) -> Array:
        """Rotation of each connected part, shape (parts, 3, 3). Collective.

        A part has one rotation, so that vectors which it turns are smooth across its bodies.

        Args:
            x: Places of the owned nodes, shape (nodes, 3) [m].
        """
        return self.of_sets(self._parts, x)

    def now(self, state: State, parts: Bools | None = None) -> Array:
        """Rotation of each connected part in a state, found once for it. Collective.

        Args:
            state: The state.
            parts: Those that are asked for, all if None; zero for others.
        """
        if self._rotations is None or self._rotations[0] != state.changes:
            self._rotations = state.changes, self.of_parts(state.places)
        Q = self._rotations[1]
        return Q if parts is None else np.where(parts[:, None, None], Q, 0.0)

    def parts_with(self, nodes: Bools) -> Bools:
        """Connected parts that have some of these owned nodes, shape (parts,). Collective."""
        counts = np.bincount(self.part[nodes], minlength=len(self._parts))
        return np.asarray(self._scene.sum(counts.astype(np.float64)) > 0)

    def of_nodes(self, x: Array, cells: Indices) -> Array:
        """Rotation of some cells round each owned node, shape (nodes, 3, 3). Collective.

        Args:
            x: Places of the owned nodes, shape (nodes, 3) [m].
            cells: These owned cells; a node that has none of them gets no rotation.
        """
        space, n = self._scene.space, len(x)
        shape, moved = fem.Function(space), fem.Function(space)
        shape.x.array[: 3 * n] = self.shape.reshape(-1)
        moved.x.array[: 3 * n] = (x - self.shape).reshape(-1)
        shape.x.scatter_forward()
        moved.x.scatter_forward()
        X = shape.x.array.reshape(-1, 3)
        local = LocalRotations(space.dofmap.list[cells], X, self._scene.comm)
        M = la.vector(space.dofmap.index_map, 9)
        local.spread(moved.x.array, M.array.reshape(-1, 9))
        M.scatter_reverse(la.InsertMode.add)
        out = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        local.fit(M.array.reshape(-1, 9)[:n], out)
        return out

    def parts_at(self, nodes: Sequence[Nodes]) -> Ints:
        """Connected part of each set of owned nodes, which may be empty on some ranks. Collective.

        Args:
            nodes: Owned nodes of each set.
        """
        local = np.array([self.part[own].max(initial=-1) for own in nodes], dtype=np.int64)
        self._scene.comm.Allreduce(MPI.IN_PLACE, local, op=MPI.MAX)
        return local


class _Frames(Kind):
    """Frames against a shape, or None, of an object that has the scene."""

    def part(self, value: Any, order: MeshOrder) -> Any:
        return None if value is None else value.shape

    def whole(self, value: Any, parts: Sequence[Any], orders: Sequence[MeshOrder]) -> Any:
        return ON_NODES.whole(parts[0], parts, orders)

    def set(self, owner: Any, name: str, whole: Any, order: MeshOrder) -> None:
        if whole is not None:
            setattr(owner, name, Frames(owner._scene, ON_NODES.own(whole, order)))


FRAMES = _Frames()


def to_shape(vectors: Array, Q: Array) -> Array:
    """Vectors in space as they are in the shape's frame, Qᵀ v; shapes (nodes, 3), (…, 3, 3)."""
    return np.asarray(np.einsum("...i,...ij->...j", vectors, Q))


def to_space(vectors: Array, Q: Array) -> Array:
    """Vectors in the shape's frame as they are in space, Q v; shapes (nodes, 3), (…, 3, 3)."""
    return np.asarray(np.einsum("...j,...ij->...i", vectors, Q))

"""Columns of the inverse of a step of e, for forces at a few nodes; each is computed once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.scene.scene import Scene

__all__ = ["Columns"]


class Columns:
    """Changes of e at the end of a step by unit forces; columns are made as they are asked for.

    Nodes have global numbers; values of all ranks are equal on all.

    Attributes:
        nodes: Nodes that have columns, three each, in the order in which they were asked for.
        inside: G, the changes at these nodes, shape (3 nodes, 3 nodes) [m/N].
    """

    def __init__(self, scene: Scene, wanted: Ints) -> None:
        """Begin without columns.

        Args:
            scene: The problem.
            wanted: Owned nodes at which changes are wanted.
        """
        self._scene, self._wanted = scene, wanted
        self._first = scene.space.dofmap.index_map.local_range[0]
        self.nodes: Ints = np.empty(0, np.int64)
        self.inside: Array = np.empty((0, 0))
        self._at: Array = np.empty((3 * wanted.size, 0))

    def have(self, nodes: Ints, step: Callable[[Array], Array]) -> None:
        """Make columns of some nodes. Collective.

        Args:
            nodes: Equal on all ranks, sorted.
            step: Takes the step under forces of the owned nodes, shape (nodes, 3) [N], and returns
                e at its end.
        """
        new = np.setdiff1d(nodes, self.nodes)
        if not new.size:
            return
        n = self._scene.owned_nodes
        force: Array = np.zeros((n, 3))
        rest, columns = step(force), []
        for node in new - self._first:
            for axis in range(3):
                mine = 0 <= node < n
                if mine:
                    force[node, axis] = 1.0
                columns.append((step(force) - rest).reshape(-1))
                if mine:
                    force[node, axis] = 0.0
        every, known = np.array(columns).T, self.nodes.size
        self.nodes = np.concatenate([self.nodes, new])
        rows = (3 * self._wanted[:, None] + np.arange(3)).reshape(-1)
        self._at = np.hstack([self._at, every[rows]])
        own, here = self._own()
        more: Array = np.zeros((self.nodes.size, 3, every.shape[1]))
        more[here] = every.reshape(n, 3, -1)[own[here]]
        more = np.asarray(self._scene.sum(more)).reshape(3 * self.nodes.size, -1)
        inside: Array = np.zeros((3 * self.nodes.size,) * 2)
        inside[: 3 * known, : 3 * known] = self.inside
        inside[:, 3 * known :] = more
        inside[3 * known :, : 3 * known] = more[: 3 * known].T  # by symmetry
        self.inside = inside

    def numbers(self, owned: npt.NDArray[np.integer]) -> Ints:
        """Global numbers of nodes that ranks own, sorted, equal on all. Collective."""
        every = self._scene.comm.allgather(self._first + np.asarray(owned, dtype=np.int64))
        return np.sort(np.concatenate(every))

    def places(self, nodes: Ints) -> Ints:
        """Rows of G of some nodes that have columns, shape (3 nodes,)."""
        order = np.argsort(self.nodes)
        at = order[np.searchsorted(self.nodes, nodes, sorter=order)]
        return np.asarray(3 * at[:, None] + np.arange(3)).reshape(-1)

    def padded(self, vector: Array) -> Array:
        """A vector of fewer columns, with zeros for those that came since, shape (3 nodes,)."""
        return np.concatenate([vector, np.zeros(3 * self.nodes.size - vector.size)])

    def of_nodes(self, vectors: Array) -> Array:
        """Vectors of owned nodes at those that have columns, one after the other. Collective."""
        out: Array = np.zeros((self.nodes.size, vectors.shape[1]))
        own, here = self._own()
        out[here] = vectors[own[here]]
        return np.asarray(self._scene.sum(out)).reshape(-1)

    def at_nodes(self, forces: Array) -> Array:
        """Forces at the nodes that have columns, of the owned nodes, shape (nodes, 3)."""
        out: Array = np.zeros((self._scene.owned_nodes, 3))
        own, here = self._own()
        out[own[here]] = forces.reshape(-1, 3)[here]
        return out

    def moved(self, end: Array, forces: Array) -> Array:
        """e where it is wanted, as forces change it from that without them, shape (nodes, 3) [m].

        Args:
            end: e without them, of the owned nodes, likewise.
            forces: At the nodes that have columns, shape (3 nodes,) [N].
        """
        out = end.copy()
        out[self._wanted] += (self._at @ forces).reshape(-1, 3)
        return out

    def _own(self) -> tuple[Ints, Bools]:
        """Owned numbers of the nodes that have columns, and which of them this rank owns."""
        own = self.nodes - self._first
        return own, (own >= 0) & (own < self._scene.owned_nodes)

"""How far a structure deflects: its displacement but for that of its supports, or a rigid one.

Some nodes stand for all, a number that does not grow with the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.effects import Preload, Spring
from rigidfx.scene.sample import spread
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Deflection"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

NODES = 1000  # that stand for all, at most
HELD = 100  # likewise for those of which supports hold a component
REST = 1e-6  # of a deflection: what moves less is at rest, as well as preloads are solved


class Deflection:
    """Remembers the largest deflection of a structure.

    Attributes:
        nodes: Owned nodes that stand for all.
        X: Their places at the start [m].
        now: How far they are deflected after the last state, shape (nodes, 3) [m].
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing has moved. Collective."""
        X = scene.start_places[: scene.owned_nodes]
        self._scene, self.nodes = scene, spread(scene.comm, X, NODES)
        self._mass, self.X = scene.averaging_mass[self.nodes], X[self.nodes]
        self._all = np.arange(self.nodes.size)
        self._mask: Bools | None = None
        self._held: list[Indices] = []
        self._counts: Array = np.zeros(3)
        self.now = np.zeros_like(self.X)
        # Deflection from which the run begins, known once a preload has made it.
        self._start: Array | None = None if scene.named(Preload) else np.zeros_like(self.X)
        # On this rank: of deflections, displacements, and changes of deflections since the start.
        self._largest: Array = np.zeros(3)

    @property
    def largest(self) -> float:
        """The largest so far, of all ranks [m]. Collective.

        No more than the largest displacement, where supports tell what is common: what stands on a
        base that shakes fast stays where it is, and what it is off by is a part of that.
        """
        far = self._of_all()
        return float(far[:2].min() if self.held else far[0])

    @property
    def moved(self) -> float:
        """How far it has deflected from where the run begins, at most `largest` [m]. Collective.

        What hangs bent by a `Preload` does not move for that.
        """
        return float(min(self.largest, max(self._of_all()[2], REST * self.largest)))

    def _of_all(self) -> Array:
        far = np.empty(3)
        self._scene.comm.Allreduce(self._largest, far, op=MPI.MAX)
        return far

    @property
    def held(self) -> bool:
        """Whether supports held anything in the last state."""
        return bool(self._counts.any())

    @property
    def flies(self) -> bool:
        """Whether neither supports nor springs did."""
        return not (self.held or self._scene.named(Spring))

    def follow(self, state: State, held: Bools) -> Array:
        """Take note of a state. Collective.

        Args:
            state: The state.
            held: For each owned dof, whether a support prescribes it; another array when that
                changes.

        Returns:
            Positions of the nodes that stand for all [m].
        """
        if held is not self._mask:
            self._find_held(held)
        x = state.positions(self.nodes)
        self.now = self._deflected(x, state)
        self._start = self.now if self._start is None else self._start
        each = self.now, x - self.X, self.now - self._start
        far = [np.linalg.norm(u, axis=1).max(initial=0.0) for u in each]
        self._largest = np.maximum(self._largest, far)
        return x

    def _find_held(self, held: Bools) -> None:
        """Take nodes that stand for those that supports hold, by component. Collective."""
        self._mask, X = held, self._scene.space.tabulate_dof_coordinates()
        self._held = []
        for of_component in held.reshape(-1, 3).T:
            nodes = np.flatnonzero(of_component)
            self._held.append(nodes[spread(self._scene.comm, X[nodes], HELD)])
        self._counts = np.asarray(self._scene.sum(np.array([float(n.size) for n in self._held])))

    def _deflected(self, x: Array, state: State) -> Array:
        """Displacements of this rank's nodes but for a common one [m]. Collective.

        What supports hold tells that, component by component; where they hold nothing at all the
        best rigid motion does, unless springs bring the structure back to where it was: then how it
        swings in them is as much of its motion as how it bends.
        """
        counts, u = self._counts, x - self.X
        if not counts.any():
            if self._scene.named(Spring):
                return u
            return self.left(self.X, x, [self._all])[0]
        moved = [
            state.positions(n)[:, k] - self._scene.start_places[n, k]
            for k, n in enumerate(self._held)
        ]
        sums = np.array([*(of.sum() for of in moved), *(self._mass @ u), self._mass.sum()])
        every = np.asarray(self._scene.sum(sums))
        common = np.where(counts > 0, every[:3] / np.maximum(counts, 1), every[3:6] / every[6])
        return np.asarray(u - common)

    def left(self, before: Array, now: Array, parts: Sequence[Indices]) -> list[Array]:
        """Of each part how far its nodes are from their best rigid motion [m]. Collective.

        In the axes from before; by masses (W. Kabsch, Acta Cryst. A 32 (1976) 922-923).

        Args:
            before: Positions of the nodes that stand for all [m].
            now: The same later [m].
            parts: Which of these are in each part.
        """
        local = np.zeros((len(parts), 16))
        for sums, nodes in zip(local, parts, strict=True):
            m, a, b = self._mass[nodes], before[nodes], now[nodes]
            sums[:] = [m.sum(), *(m @ a), *(m @ b), *((m[:, None] * a).T @ b).ravel()]
        out = []
        for sums, nodes in zip(np.reshape(self._scene.sum(local), (-1, 16)), parts, strict=True):
            m = max(sums[0], np.finfo(float).tiny)
            a, b = sums[1:4] / m, sums[4:7] / m
            W, _, Vt = np.linalg.svd(sums[7:].reshape(3, 3) / m - np.outer(a, b))
            turn = W @ np.diag([1.0, 1.0, np.sign(np.linalg.det(W @ Vt))]) @ Vt
            out.append((now[nodes] - b) @ turn.T - (before[nodes] - a))
        return out

"""How far a structure deflects, and how far parts of it bend by themselves.

A strain rate says how fast a cell deforms, not what that amounts to: cells that strain a little,
one beside the other, bend a slender part by a good part of what its structure moves, and what
strains fast may be a vibration that moves nothing far. So what a body withholds is a displacement,
too. It is compared as rates are: a tolerance is some part of the largest strain rate, and the same
part of the largest deflection is what a body may bend by. Some nodes stand for all, a number that
does not grow with the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.decide.memory.sample import spread
from rigidfx.effects import Spring
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Bends"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Nodes = npt.NDArray[np.int32]
Indices = npt.NDArray[np.intp]

NODES = 1000  # that stand for all, at most
HELD = 100  # likewise for those of which supports hold a component
MOST = 8  # shapes of a window that are kept: the first, and others as far apart as may be


class Bends:
    """Remembers the largest deflection of a structure, and its shapes in a window.

    Attributes:
        per_rate: Largest deflection over largest strain rate so far, at the end of the last window
            [m s]; infinite while nothing but rounding has strained.
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing has moved. Collective."""
        X = scene.space.tabulate_dof_coordinates()[: scene.owned_nodes]
        self._scene, self._nodes = scene, spread(scene.comm, X, NODES)
        self._mass, self._X = scene.nodal_mass[self._nodes], X[self._nodes]
        self._all = np.arange(self._nodes.size)
        self._mask: Bools | None = None
        self._held: list[Indices] = []
        self.per_rate, self._largest = np.inf, 0.0
        self._shapes: list[Array] = []
        self._stride, self._waited = 1, 0

    def window_begins(self) -> None:
        """Forget the shapes of the last window."""
        self._shapes, self._stride, self._waited = [], 1, 0

    def add(self, state: State, held: Bools) -> None:
        """Take note of a state. Collective.

        Args:
            state: The state.
            held: For each owned dof, whether a support prescribes it; another array when that
                changes.
        """
        if held is not self._mask:
            self._find_held(held)
        x = state.positions(self._nodes)
        self._largest = max(self._largest, self._deflection(x, state))
        self._waited += 1
        if not self._shapes or self._waited == self._stride:
            self._waited = 0
            self._shapes.append(x)
            if len(self._shapes) > MOST:
                self._shapes, self._stride = self._shapes[::2], 2 * self._stride

    def _find_held(self, held: Bools) -> None:
        """Take nodes that stand for those that supports hold, by component. Collective."""
        self._mask, X = held, self._scene.space.tabulate_dof_coordinates()
        self._held = []
        for of_component in held.reshape(-1, 3).T:
            nodes = np.flatnonzero(of_component)
            self._held.append(nodes[spread(self._scene.comm, X[nodes], HELD)])
        self._counts = np.asarray(self._scene.sum(np.array([float(n.size) for n in self._held])))

    def look(self, rate: float, noise: float) -> None:
        """Take note of the end of a window. Collective.

        Args:
            rate: Largest strain rate so far, on any rank [1/s].
            noise: Strain rate that rounding may leave [1/s].
        """
        largest = self._scene.comm.allreduce(self._largest, op=MPI.MAX)
        if rate > noise and largest > 0:
            self.per_rate = largest / rate

    def limits(self, rates: Array) -> Array | None:
        """Displacements that are to the largest what rates are to the largest [m].

        Args:
            rates: Strain rates [1/s].

        Returns:
            Of each; None while nothing but rounding has strained.
        """
        return rates * self.per_rate if np.isfinite(self.per_rate) else None

    def swings(self, parts: Sequence[Nodes]) -> Array:
        """How far each of some parts has bent in the window, at most, from its first shape [m].

        Collective.

        Args:
            parts: Owned nodes of each.
        """
        first, *others = self._shapes or [self._X]
        known = [np.flatnonzero(np.isin(self._nodes, own)) for own in parts]
        out: Array = np.zeros(len(parts))
        for x in others:
            out = np.maximum(out, self._bent(first, x, known))
        return out

    def _deflection(self, x: Array, state: State) -> float:
        """Largest displacement on this rank but for a common one [m]. Collective.

        What supports hold tells that, component by component; where they hold nothing at all the
        best rigid motion does, unless springs bring the structure back to where it was: then how it
        swings in them is as much of its motion as how it bends.
        """
        counts, u = self._counts, x - self._X
        if not counts.any():
            if self._scene.named(Spring):
                return float(np.linalg.norm(u, axis=1).max(initial=0.0))
            return float(self._left(self._X, x, [self._all])[0].max(initial=0.0))
        moved = [state.positions(n)[:, k] - state.X[n, k] for k, n in enumerate(self._held)]
        sums = np.array([*(of.sum() for of in moved), *(self._mass @ u), self._mass.sum()])
        every = np.asarray(self._scene.sum(sums))
        common = np.where(counts > 0, every[:3] / np.maximum(counts, 1), every[3:6] / every[6])
        return float(np.linalg.norm(u - common, axis=1).max(initial=0.0))

    def _bent(self, before: Array, now: Array, parts: Sequence[Indices]) -> Array:
        """Largest displacement of each part but for its rigid motion [m]. Collective.

        Args:
            before: Positions of the nodes that stand for all [m].
            now: The same later [m].
            parts: Which of these are in each part.
        """
        left = self._left(before, now, parts)
        out = np.array([apart.max(initial=0.0) for apart in left])
        self._scene.comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
        return out

    def _left(self, before: Array, now: Array, parts: Sequence[Indices]) -> list[Array]:
        """Of each part how far its nodes are from their best rigid motion [m]. Collective.

        By masses (W. Kabsch, Acta Cryst. A 32 (1976) 922-923).
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
            out.append(np.linalg.norm(now[nodes] - b - (before[nodes] - a) @ turn, axis=1))
        return out

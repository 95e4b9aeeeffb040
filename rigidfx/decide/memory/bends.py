"""How far parts of a structure bend by themselves, beside how far it deflects.

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

from rigidfx.decide.memory.deflection import Deflection
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Bends"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Nodes = npt.NDArray[np.int32]
Indices = npt.NDArray[np.intp]
Ints = npt.NDArray[np.int64]

MOST = 8  # shapes of a window that are kept: the first, and others as far apart as may be


class Bends:
    """Remembers the largest deflection of a structure, and its shapes in a window.

    Attributes:
        deflection: How far it deflects.
        per_rate: Largest deflection over largest strain rate so far, at the end of the last window
            [m s]; infinite while nothing but rounding has strained.
        together: Sum over all bodies of what each would bend by, over what it may.
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing has moved. Collective."""
        self._comm, self.deflection = scene.comm, Deflection(scene)
        self.per_rate, self.together = np.inf, 0.0
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
        x = self.deflection.follow(state, held)
        self._waited += 1
        if not self._shapes or self._waited == self._stride:
            self._waited = 0
            self._shapes.append(x)
            if len(self._shapes) > MOST:
                self._shapes, self._stride = self._shapes[::2], 2 * self._stride

    def look(self, rate: float, noise: float) -> None:
        """Take note of the end of a window. Collective.

        Args:
            rate: Largest strain rate so far, on any rank [1/s].
            noise: Strain rate that rounding may leave [1/s].
        """
        largest = self.deflection.largest
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

    def add_up(self, bends: Array | None, bodies: Ints) -> None:
        """Take note of what bodies would bend by. Collective.

        Args:
            bends: Of each owned cell, over its limit; None where there is none.
            bodies: Number of the body that it is in, below zero where it is in none.
        """
        self.together = 0.0
        if bends is None:
            return
        count = self._comm.allreduce(int(bodies.max(initial=-1)) + 1, op=MPI.MAX)
        most, inside = np.zeros(count), bodies >= 0
        np.maximum.at(most, bodies[inside], bends[inside])
        self._comm.Allreduce(MPI.IN_PLACE, most, op=MPI.MAX)
        self.together = float(most.sum())

    def swings(self, parts: Sequence[Nodes]) -> Array:
        """How far each of some parts has bent in the window, at most, from its first shape [m].

        Collective.

        Args:
            parts: Owned nodes of each.
        """
        first, *others = self._shapes or [self.deflection.X]
        known = [np.flatnonzero(np.isin(self.deflection.nodes, own)) for own in parts]
        out: Array = np.zeros(len(parts))
        for x in others:
            out = np.maximum(out, self._bent(first, x, known))
        return out

    def _bent(self, before: Array, now: Array, parts: Sequence[Indices]) -> Array:
        """Largest displacement of each part but for its rigid motion [m]. Collective.

        Args:
            before: Positions of the nodes that stand for all [m].
            now: The same later [m].
            parts: Which of these are in each part.
        """
        left = self.deflection.left(before, now, parts)
        out = np.array([apart.max(initial=0.0) for apart in left])
        self._comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
        return out

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

__all__ = ["FAST", "Bends"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Nodes = npt.NDArray[np.int32]
Indices = npt.NDArray[np.intp]
Ints = npt.NDArray[np.int64]

# Of the largest deflection so far, what a body may bend by at most: a tolerance that is more of the
# largest rate so far is meant for a faster motion to come, which may go less far than this one. A
# bar that swung slowly before a blow along it was half off.
PART = 0.02
FAST = 1.0  # steps in which what is to come may turn round, at the least
MOST = 8  # shapes of a window that are kept: the first, and others as far apart as may be


class Bends:
    """Remembers the largest deflection of a structure, and its shapes in a window.

    Attributes:
        deflection: How far it deflects.
        per_rate: Largest deflection over largest strain rate so far, at the end of the last window
            [m s]; infinite while nothing but rounding has strained.
        most: What a body may bend by at most [m]; no limit where nothing is held.
        together: Sum over all bodies of what each would bend by, over what it may.
    """

    def __init__(self, scene: Scene) -> None:
        """Nothing has moved. Collective."""
        self._comm, self.deflection = scene.comm, Deflection(scene)
        self.per_rate, self.most, self.together = np.inf, np.inf, 0.0
        self._faster = 1.0  # part of the present stroke in which what is to come may turn round
        self._shapes: list[tuple[Array, Array]] = []  # places, and how far they are deflected
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
        # What flies goes farther than it deflects.
        self.most = np.inf if self.deflection.flies else PART * self.deflection.moved
        self._waited += 1
        if not self._shapes or self._waited == self._stride:
            self._waited = 0
            self._shapes.append((x, self.deflection.now))
            if len(self._shapes) > MOST:
                self._shapes, self._stride = self._shapes[::2], 2 * self._stride

    def look(self, rate: float, noise: float, steps: float = FAST) -> None:
        """Take note of the end of a window. Collective.

        Args:
            rate: Largest strain rate so far, on any rank [1/s].
            noise: Strain rate that rounding may leave [1/s].
            steps: In how many steps the motion so far turns round.
        """
        moved = self.deflection.moved
        if rate > noise and moved > 0:
            self.per_rate = moved / rate
            self._faster = min(FAST / steps, 1.0)

    def limits(self, rates: Array) -> Array | None:
        """Displacements that are to the largest what rates are to the largest [m].

        They are no more than `PART` of it, or than these rates amount to in a fast motion.

        Args:
            rates: Strain rates [1/s].

        Returns:
            Of each; None while nothing but rounding has strained.
        """
        if not np.isfinite(self.per_rate):
            return None
        may = rates * self.per_rate
        return np.minimum(may, np.maximum(self.most, self._faster * may))

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

    def swing(self) -> float:
        """How far the structure has deflected in the window, at most, from its first shape [m].

        Of what no support holds its best rigid motion is none, on springs neither. Collective.
        """
        if not self.deflection.held:
            return float(self.swings([self.deflection.nodes.astype(np.int32)])[0])
        far = [0.0]
        for _, now in self._shapes[1:]:
            far.append(float(np.linalg.norm(now - self._shapes[0][1], axis=1).max(initial=0.0)))
        return float(self._comm.allreduce(max(far), op=MPI.MAX))

    def swings(self, parts: Sequence[Nodes]) -> Array:
        """How far each of some parts has bent in the window, at most, from its first shape [m].

        Collective.

        Args:
            parts: Owned nodes of each.
        """
        first, *others = [x for x, _ in self._shapes] or [self.deflection.X]
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
        out = np.array([np.linalg.norm(apart, axis=1).max(initial=0.0) for apart in left])
        self._comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
        return out

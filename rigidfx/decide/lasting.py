"""Which parts freeze of those that are quiet: such as will last, and save what they cost.

A freeze that the next steps would undo does not happen, nor does one that saves less than its
switches take: see `criteria/concentration.py` and `memory/work.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import pi

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.decide.clusters import CellGraph
from rigidfx.decide.criteria.concentration import Concentration
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.criteria.kinks import Kinks
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.decision import Decision, PlannedBody
from rigidfx.decide.enclosed import round_enclosed
from rigidfx.decide.memory.memory import Memory
from rigidfx.decide.memory.work import too_dear
from rigidfx.flexible.indicator import Indicator
from rigidfx.scene.scene import Scene

__all__ = ["Lasting"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int32]


FIRM = 1 / 3  # times what releases a body by its bend: what lets it freeze
GENTLE = 4.0  # times its rates a motion may grow by in half a window as loads set in gently
STILL = 0.1  # of the loudest cell's rate, over tolerances, what hardly bends in a slow motion
QUIETER = 0.8  # times the loudest cell of parts that do too much: what may still be rigid


class Lasting:
    """Knows what concerns a structure when parts of it become rigid."""

    def __init__(
        self,
        scene: Scene,
        graph: CellGraph,
        criterion: Criterion,
        memory: Memory,
        indicator: Indicator,
    ) -> None:
        """Take the stiffness of the cells. Collective.

        Args:
            scene: The problem.
            graph: Neighbours of its cells.
            criterion: What the user states.
            memory: What the policy remembers.
            indicator: A measure of its own.
        """
        self._comm, self._criterion, self._memory = scene.comm, criterion, memory
        self._graph = graph
        self._concentration, self._kinks = Concentration(scene), Kinks(scene, graph, indicator)

    def bodies(
        self,
        plan: Callable[[Bools, Bools], Decision],
        seen: Observation,
        tol: Array,
        able: Bools,
        barred: Bools,
    ) -> Decision:
        """The freeze of the parts that last. Collective.

        Args:
            plan: Finds bodies of the cells that are able, without those that are barred.
            seen: The state at the end of a window.
            tol: Strain rate up to which each owned cell is quiet [1/s].
            able: Owned cells that may freeze.
            barred: Owned cells that may not.
        """
        memory, flexible = self._memory, seen.flexible
        worst, start = memory.window.worst, memory.window.start
        resting, length = memory.loads.resting_since <= start, seen.t - start
        half = pi * memory.strokes.turning  # period of what moves; 0 where nothing does
        most = self._criterion.louder(resting, 0 < half <= length)
        if resting and half > length and np.isfinite(memory.strokes.dying):
            out = able & self._creeping(worst, most * tol, length)
            able, barred = able & ~out, barred | out
        quiet = np.asarray(memory.window.steps * (1 + memory.back_off.observed / length))
        loud = np.zeros_like(tol)
        np.divide(worst, tol, out=loud, where=tol > 0)
        while True:
            found = plan(able, barred)
            new = [body for body in found.bodies if not body.kept]
            parts = [body.cells[flexible[body.cells]] for body in new]
            out = round_enclosed(self._graph, parts, able, loud, self._criterion.enclosing)
            if not self._some(out) and np.isfinite(most):
                weights = seen.indicator.weights
                out = self._concentration.too_loud(parts, worst, weights, tol, flexible, most)
                if self._some(out):
                    for own, loudest in zip(parts, self._kinks.loud(seen, new, tol), strict=True):
                        out[own] &= loudest > most
            if not self._some(out):
                out = self._drifting(parts, loud, resting)
            if not self._some(out):
                out = self._bent(new, parts, loud, tol)
            if not self._some(out) and self._criterion.patience > 1:
                out = too_dear(parts, quiet, flexible, self._comm)
            if not self._some(out):
                return found
            able, barred = able & ~out, barred | out

    def _creeping(self, worst: Array, most: Array, length: float) -> Bools:
        """Owned cells that have to strain by too much until they are at rest.

        What dies down as exp(-t/T) without a turn still strains by ė T, and a body withholds that.

        Args:
            worst: Largest strain rate of each in the window [1/s].
            most: What it may come to strain at, half of what wakes it [1/s].
            length: Length of the window [s].
        """
        strokes = self._memory.strokes
        return np.asarray(worst * strokes.dying > 2 * most * strokes.of_strains(length))

    def _drifting(self, parts: Sequence[Ints], loud: Array, resting: bool) -> Bools:
        """Cells of parts with which a motion would be too far off. Collective.

        Where loads rest these are the loudest ones, where they change the part that strains most;
        what of that is hardly strained may stay if only how far all goes is in question.
        """
        drift, turning = self._memory.drift, self._memory.strokes.turning
        if turning == 0 or not np.isfinite(drift.limit):
            return np.zeros(loud.size, dtype=bool)
        shares = np.array([0.0, *(drift.shares[own].sum() for own in parts)])
        self._comm.Allreduce(MPI.IN_PLACE, shares, op=MPI.SUM)
        more = shares.sum()
        rigid, room = drift.share + more, drift.room(turning, resting)
        if more == 0 or rigid <= (room if resting else min(room, drift.room_to_go)):
            return np.zeros(loud.size, dtype=bool)
        if not resting:
            parts = [parts[int(np.argmax(shares[1:]))]]
        if resting or rigid <= room:
            most = float(self._largest([loud[own] for own in parts]).max(initial=0.0))
            most *= 1.0 if resting else STILL
            return self._loudest(parts, loud, [most for _ in parts])
        every = np.zeros(loud.size, dtype=bool)
        every[parts[0]] = True
        return every

    def _bent(
        self, new: Sequence[PlannedBody], parts: Sequence[Ints], loud: Array, tol: Array
    ) -> Bools:
        """The loudest owned cells of parts that bend too much as a whole. Collective.

        While a motion rises, what they bend by rises with it, and what they may does not. A rise as
        loads set in gently tells of none to come.
        """
        bends = self._memory.bends
        limits = bends.limits(tol)
        if limits is None or not new:
            return np.zeros(tol.size, dtype=bool)
        least = -self._largest([-limits[own] for own in parts])
        growth = self._memory.strokes.growth
        firm = FIRM / (growth if growth > GENTLE else 1.0) * least
        bent = bends.swings([body.nodes for body in new]) > firm
        most = self._largest([loud[own] for own in parts])
        return self._loudest(parts, loud, np.where(bent, most, np.inf))

    def _loudest(self, parts: Sequence[Ints], loud: Array, most: Sequence[float] | Array) -> Bools:
        """Cells of each part that are not much quieter than its loudest one."""
        out = np.zeros(loud.size, dtype=bool)
        for own, largest in zip(parts, most, strict=True):
            out[own] = loud[own] >= QUIETER * largest
        return out

    def _largest(self, of_each: Sequence[Array]) -> Array:
        """The largest number of each part; of one without cells minus infinity. Collective."""
        out = np.array([numbers.max(initial=-np.inf) for numbers in of_each])
        self._comm.Allreduce(MPI.IN_PLACE, out, op=MPI.MAX)
        return out

    def _some(self, cells: Bools) -> bool:
        """Whether there are any on any rank. Collective."""
        return bool(self._comm.allreduce(bool(cells.any()), op=MPI.LOR))

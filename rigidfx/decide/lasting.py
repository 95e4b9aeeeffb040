"""Which parts freeze of those that are quiet: such as will last, and save what they cost.

A freeze that the next steps would undo does not happen, nor does one that saves less than its
switches take: see `criteria/concentration.py` and `memory/work.py`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.decide.criteria.concentration import Concentration
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.decision import Decision
from rigidfx.decide.memory.memory import Memory
from rigidfx.scene.scene import Scene

__all__ = ["Lasting"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]


class Lasting:
    """Knows what concerns a structure when parts of it become rigid."""

    def __init__(self, scene: Scene, memory: Memory) -> None:
        """Take the stiffness of the cells. Collective.

        Args:
            scene: The problem.
            memory: What the policy remembers.
        """
        self._comm, self._memory = scene.comm, memory
        self._concentration = Concentration(scene)

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
        memory = self._memory
        worst, start = memory.window.worst, memory.window.start
        resting = memory.loads.resting_since <= start
        length = seen.t - start
        quiet = np.asarray(memory.window.steps * (1 + memory.back_off.observed / length))
        weights, flexible = seen.indicator.weights, seen.flexible
        while True:
            found = plan(able, barred)
            parts = [b.cells[flexible[b.cells]] for b in found.bodies if not b.kept]
            out = np.zeros_like(able)
            if resting:
                out = self._concentration.too_loud(parts, worst, weights, tol, flexible)
            if not self._some(out):
                out = memory.work.too_dear(parts, quiet, flexible, self._comm)
                if not self._some(out):
                    return found
            able, barred = able & ~out, barred | out

    def _some(self, cells: Bools) -> bool:
        """Whether there are any on any rank. Collective."""
        return bool(self._comm.allreduce(bool(cells.any()), op=MPI.LOR))

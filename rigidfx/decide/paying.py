"""Which quiet parts freeze if the error motion is known: those that pay for their switches.

The error motion corrects the effect of a freeze, so only its cost decides (`memory.work`). Enclosed
cells freeze with a part unless they strain too fast (`enclosed`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Bools
from rigidfx.decide.clusters import CellGraph
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.decision import Decision
from rigidfx.decide.enclosed import round_enclosed
from rigidfx.decide.memory.memory import Memory
from rigidfx.decide.memory.work import too_dear

__all__ = ["Paying"]


class Paying:
    """Knows for how long cells have been quiet."""

    def __init__(self, graph: CellGraph, criterion: Criterion, memory: Memory) -> None:
        """Keep the memory.

        Args:
            graph: Neighbours of the cells.
            criterion: The criterion of the user.
            memory: Memory of the policy.
        """
        self._graph, self._comm, self._memory = graph, graph.comm, memory
        self._waits, self._enclosing = criterion.patience > 1, criterion.enclosing

    def bodies(
        self,
        plan: Callable[[Bools, Bools], Decision],
        seen: Observation,
        tol: Array,
        able: Bools,
        barred: Bools,
    ) -> Decision:
        """The freeze of the parts that pay. Collective.

        Args:
            plan: Finds bodies of the cells that are able, without those that are barred.
            seen: The state at the end of a window.
            tol: Strain rate up to which each owned cell is quiet [1/s].
            able: Owned cells that may freeze.
            barred: Owned cells that may not.
        """
        window, observed = self._memory.window, self._memory.back_off.observed
        quiet = np.asarray(window.steps * (1 + observed / (seen.t - window.start)))
        loud = np.zeros_like(tol)
        np.divide(window.worst, tol, out=loud, where=tol > 0)
        while True:
            found = plan(able, barred)
            new = (body.cells for body in found.bodies if not body.kept)
            parts = [cells[seen.flexible[cells]] for cells in new]
            out = round_enclosed(self._graph, parts, able, loud, self._enclosing)
            if self._waits:
                out |= too_dear(parts, quiet, seen.flexible, self._comm)
            if not self._comm.allreduce(bool(out.any()), op=MPI.LOR):
                return found
            able, barred = able & ~out, barred | out

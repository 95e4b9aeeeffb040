"""Which quiet parts freeze where bodies get shapes: those that pay for their switches.

Shapes follow what forces do to a body, so only the cost decides: flexible steps that a switch
costs, and those that a part has been quiet for. Enclosed cells freeze with a part unless
they strain too fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.clusters import CellGraph
from rigidfx.decide.criteria.judging import Criterion, Observation
from rigidfx.decide.decision import Decision
from rigidfx.decide.memory.memory import Memory

SWITCHES = 7.0  # flexible steps that a freeze and a release of a body take


def too_dear(parts: Sequence[Indices], quiet: Array, flexible: Bools, comm: MPI.Intracomm) -> Bools:
    """Owned cells of parts whose work while quiet is below the cost of switches. Collective.

    Args:
        parts: Owned flexible cells that are to freeze, of each body that is to be.
        quiet: Steps in a row in which each owned cell has been quiet.
        flexible: Cells that are flexible now.
        comm: Ranks that share the cells.
    """
    out = np.zeros(quiet.size, dtype=bool)
    sums = np.array([flexible.sum(), *(quiet[own].sum() for own in parts)])
    comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    for own, wasted in zip(parts, sums[1:], strict=True):
        out[own] = wasted < SWITCHES * sums[0]
    return out


def round_enclosed(
    graph: CellGraph, parts: Sequence[Indices], able: Bools, loud: Array, most: float
) -> Bools:
    """Enclosed cells that strain too fast, with the cells round them. Collective.

    Such a cell would wake soon after the freeze. So it stays flexible, with a ring of cells.

    Args:
        graph: Neighbours of the cells.
        parts: Owned flexible cells that are to freeze, of each body that is to be.
        able: Owned cells that may freeze; others are in parts because these enclose them.
        loud: Strain rate of each owned cell over its tolerance.
        most: Permitted strain of an enclosed cell, over its tolerance.
    """
    inside = np.zeros(loud.size)
    for own in parts:
        inside[own] = (~able & (loud > most))[own]
    return graph.touching(graph.largest_at_nodes(inside) > 0)


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

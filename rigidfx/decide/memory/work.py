"""Work on quiet cells, which decides whether a freeze pays: counted in steps, not in seconds.

A freeze and its release need new equations, tangents and factors, for any number of cells. They
save the work on the body's cells while these stay rigid, but the number of these steps is unknown.
So a freeze waits until the work on its quiet cells has reached the cost of both. This is the rule
of the ski-rental problem: it costs at most twice as much as with perfect foresight (A.R. Karlin,
M.S. Manasse, L. Rudolph and D.D. Sleator, Algorithmica 3 (1988) 79-119).

The unit is a flexible step. At 7056 unknowns, with kept tangents and five iterations a step, a
freeze and a release cost 12 steps, those of the error motion included. The rule takes less, since
bodies change together with others, and since switches cost fewer steps if a step takes more
iterations. Iterations and tangents of steps are not counted: they depend on the solver, and so on
the number of ranks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices

__all__ = ["too_dear"]


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

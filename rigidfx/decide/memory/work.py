"""Work in steps, by which it is told whether a freeze pays: not in seconds, which differ.

A freeze, and the release that ends it, take new equations, tangents and factors, whatever their
size. It saves the work on its cells in each step that they stay rigid, and the number of these
steps is unknown. So it waits until as much work has been done for nothing on cells that were
quiet as the two cost: as who hires skis until he has paid their price, one pays at most twice what
one would have paid with foresight (A.R. Karlin, M.S. Manasse, L. Rudolph and D.D. Sleator,
Algorithmica 3 (1988) 79-119).

The unit is a flexible step. At 7056 unknowns, with kept tangents and five iterations a step, a
freeze and a release took 12 of them, those of the error motion included; as bodies come and go
together with others, less than the sum is asked for, and where steps take more iterations switches
are the fewer of them. Iterations and tangents of the steps themselves are not counted: they depend
on the solver, which depends on the ranks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

__all__ = ["too_dear"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int32]

SWITCHES = 7.0  # flexible steps that a freeze and a release of a body take


def too_dear(parts: Sequence[Ints], quiet: Array, flexible: Bools, comm: MPI.Intracomm) -> Bools:
    """Owned cells of parts on which less has been done for nothing than switches cost. Collective.

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

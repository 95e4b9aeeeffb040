"""Work in counts, by which it is told whether a freeze pays: not in seconds, which differ.

A freeze, and the release that ends it, take new equations, tangents and factors, whatever their
size. What it saves is the work on its cells in each step that they stay rigid, and nobody knows
how many there will be. So it waits until as much work has been done for nothing on cells that were
quiet as the two cost: as who hires skis until he has paid their price, one pays at most twice what
one would have paid with foresight (A.R. Karlin, M.S. Manasse, L. Rudolph and D.D. Sleator,
Algorithmica 3 (1988) 79-119).

The unit is an iteration. At 7056 unknowns, with kept tangents, one took 8 ms, a freeze 37 of them
and a release 24, shadows and their factors included; as bodies come and go together with others,
less than the sum is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

__all__ = ["Work"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int32]

TANGENT = 5.0  # iterations that a tangent with its factors takes
SWITCHES = 45.0  # those that a freeze and a release of a body take


class Work:
    """Counts the work of the steps in a window."""

    def __init__(self) -> None:
        """Nothing has been done."""
        self._steps, self._iterations = 0, 0.0

    def follow(self, iterations: int, tangents: int) -> None:
        """Take note of a step.

        Args:
            iterations: Of Newton's method, or of the chord method.
            tangents: New ones.
        """
        self._steps += 1
        self._iterations += iterations + TANGENT * tangents

    def window_begins(self) -> None:
        """Count anew."""
        self._steps, self._iterations = 0, 0.0

    @property
    def price(self) -> float:
        """Steps of the present window that cost as much as a freeze and a release."""
        return SWITCHES * self._steps / self._iterations if self._iterations > 0 else 0.0

    def too_dear(
        self, parts: Sequence[Ints], quiet: Array, flexible: Bools, comm: MPI.Intracomm
    ) -> Bools:
        """Owned cells of parts on which less work has been done for nothing than that. Collective.

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
            out[own] = wasted < self.price * sums[0]
        return out

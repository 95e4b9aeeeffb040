"""What it takes to have flexible cells dealt out among ranks, and what that gains: runs in turn."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import Any, ClassVar
from unittest.mock import patch

import numpy as np
from mpi4py import MPI

from rigidfx.coupling import dealt_rows
from rigidfx.step import stepper

from .ceiling import COMM, ONE, Made, over, started, with_ceiling
from .turns import timed

__all__ = ["in_turn"]


class Timed(dealt_rows.Dealing):
    """Deals cells out, and has them once more, as for a change of bodies that leaves them flexible.

    Attributes:
        dealt: Times to deal cells out [s].
        kept: Times to have them once more [s].
    """

    dealt: ClassVar[list[float]] = []
    kept: ClassVar[list[float]] = []

    def rows(self, layout: Any, loaded: Any) -> dealt_rows.DealtRows | None:
        """See the base class."""
        for times in (self.dealt, self.kept):
            COMM.barrier()
            seconds, rows = timed(lambda: super(Timed, self).rows(layout, loaded))
            if rows is None:
                return None
            times.append(COMM.allreduce(seconds, op=MPI.MAX))
            if times is self.dealt:
                rows.destroy()
        return rows


def in_turn(
    made: Callable[[bool, MPI.Intracomm], Made],
    share: Callable[[], Made],
    steps: int,
) -> dict[str, Any]:
    """Steps with flexible cells dealt, left where they are, redistributed, and of one rank.

    Args:
        made: A scene most of which is rigid, and Δt [s]; whether its mesh is redistributed with
            that known, and its ranks.
        share: The same with a rank's share of the unknowns, on this rank alone.
        steps: How many are timed of each.
    """
    with patch.object(stepper, "Dealing", Timed):
        runs = {"dealt": started(*made(False, COMM))}
    with patch.object(dealt_rows, "LOPSIDED", np.inf):
        runs["left"] = started(*made(False, COMM))
    runs["redistributed"] = started(*made(True, COMM))
    seconds, told = with_ceiling(runs, lambda: made(False, MPI.COMM_SELF), share, steps)
    unknowns = next(runs["dealt"]).unknowns
    for run in runs.values():
        run.close()  # type: ignore[attr-defined]
    return {
        "unknowns_of_a_step": unknowns,
        "dealt_over": {
            name: over(seconds, "dealt", name) for name in ("left", "redistributed", ONE)
        },
        **told,
        "seconds_to_deal": median(Timed.dealt) if Timed.dealt else None,
        "seconds_to_keep": median(Timed.kept) if Timed.kept else None,
    }

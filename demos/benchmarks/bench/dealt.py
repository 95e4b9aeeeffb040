"""What it takes to have flexible cells dealt out among ranks, and what that gains: runs in turn."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import Any, ClassVar
from unittest.mock import patch

import numpy as np
from mpi4py import MPI

import rigidfx as rf
from rigidfx.coupling import dealt_rows
from rigidfx.step import stepper

from .turns import timed

__all__ = ["in_turn"]

COMM = MPI.COMM_WORLD
WARM = 4  # reports before the first step that is timed, the initial state's among them


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
    made: Callable[[bool, MPI.Intracomm], tuple[rf.Scene, float]], steps: int
) -> dict[str, Any]:
    """Steps with flexible cells dealt, left where they are, redistributed, and of one rank.

    Args:
        made: A scene most of which is rigid, and Δt [s]; whether its mesh is redistributed with
            that known, and its ranks.
        steps: How many are timed of each.
    """

    def run(redistributed: bool, comm: MPI.Intracomm) -> Any:
        scene, dt = made(redistributed, comm)
        reports = rf.simulate(scene, dt, 1e6 * dt, progress=False)
        for _ in range(WARM):
            report = next(reports)
        return reports, report

    with patch.object(stepper, "Dealing", Timed):
        runs = {"dealt": run(False, COMM)}
    with patch.object(dealt_rows, "LOPSIDED", np.inf):
        runs["left"] = run(False, COMM)
    runs["redistributed"] = run(True, COMM)
    if COMM.rank == 0:
        runs["one rank"] = run(False, MPI.COMM_SELF)
    seconds: dict[str, list[float]] = {name: [] for name in (*runs, "one rank")}
    for _ in range(steps):
        for name, times in seconds.items():
            COMM.barrier()
            taken, _ = timed(lambda name=name: next(runs[name][0]) if name in runs else None)
            times.append(COMM.allreduce(taken, op=MPI.MAX))
    unknowns = runs["dealt"][1].unknowns
    for reports, _ in runs.values():
        reports.close()
    dealt = np.array(seconds["dealt"])
    return {
        "ranks": COMM.size,
        "unknowns_of_a_step": unknowns,
        "seconds_per_step": {name: median(times) for name, times in seconds.items()},
        "dealt_over": {
            name: float(np.median(dealt / times))
            for name, times in seconds.items()
            if name != "dealt"
        },
        "seconds_to_deal": median(Timed.dealt) if Timed.dealt else None,
        "seconds_to_keep": median(Timed.kept) if Timed.kept else None,
    }

"""What several cores can gain at most on a machine whose memory they share, measured beside runs.

Cores add up what they compute, not what they read: a step of a large system reads a matrix and its
factors over and over, and memory gives all cores together hardly more than one of them takes. Two
ceilings are told, both of the present hour, as neighbours of a virtual server count as well:

* independent runs, one on each core, of a mesh that has a rank's share of the unknowns: they
  exchange nothing and wait for nobody. As one of them takes `alone` and all of them at the same
  time take `together`, n ranks are not faster than one by more than n · alone/together;
* 1/(s/b + (1 - s)/n), with the part s of a step in which linear systems are solved, and with b, how
  much more all cores together get from memory than one. That is an estimate: what stays in caches
  between uses is faster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from statistics import mean, median
from time import sleep
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import rigidfx as rf

from .turns import timed

__all__ = ["COMM", "ONE", "over", "started", "with_ceiling"]

COMM = MPI.COMM_WORLD
ONE = "one rank"
ALONE, TOGETHER = "share alone", "shares together"
TRIAD, TRIADS = "triad alone", "triads together"
WARM = 4  # reports before the first step that is timed, the initial state's among them
ENTRIES = 4_000_000  # of a vector: three of them are 96 MB, beyond caches
TRIADS_OF_A_TURN = 10
BYTES = 24  # that a triad reads and writes for each entry
Calls = Mapping[str, Callable[[], Any] | None]  # None where a rank has to wait
Made = tuple[rf.Scene, float]  # a scene and Δt [s]


def started(scene: rf.Scene, dt: float) -> Iterator[rf.Report]:
    """A run that has taken its first steps. Collective on the scene's ranks."""
    reports = rf.simulate(scene, dt, 1e6 * dt, progress=False)
    for _ in range(WARM):
        next(reports)
    return reports


def _in_turn(calls: Calls, times: int) -> dict[str, list[float]]:
    """Calls one after the other, so often; each by the ranks that have it, at the same time.

    Args:
        calls: The same names on all ranks.
        times: How often each is made.

    Returns:
        Wall times of each [s], of the rank that takes longest.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(times):
        for name, call in calls.items():
            _meet()
            taken = timed(call)[0] if call else 0.0
            _meet()
            seconds[name].append(COMM.allreduce(taken, op=MPI.MAX))
    return seconds


def _meet() -> None:
    """Wait for all ranks, without keeping a core busy while others are timed. Collective."""
    request = COMM.Ibarrier()
    while not request.Test():
        sleep(1e-3)


def over(seconds: Mapping[str, list[float]], one: str, other: str) -> float:
    """Median over the turns of one call's time relative to another's."""
    return float(np.median(np.divide(seconds[one], seconds[other])))


def with_ceiling(
    runs: Mapping[str, Iterator[rf.Report]],
    whole: Callable[[], Made],
    share: Callable[[], Made],
    steps: int,
) -> tuple[dict[str, list[float]], dict[str, Any]]:
    """Steps of all ranks and of one in turn, and how much faster all could be at most. Collective.

    Args:
        runs: Runs of all ranks; the first of them is compared with that of one.
        whole: The problem, on one rank.
        share: The same with a rank's share of the unknowns, on this rank alone.
        steps: How many are timed of each. PETSc counts times since before.

    Returns:
        Wall times by the names of the runs, that of `ONE` rank and others among them [s], and a
        summary.
    """
    name = next(iter(runs))
    steps_of_all = {each: _Counted(run) for each, run in runs.items()}
    alone = _Counted(started(*whole())) if COMM.rank == 0 else None
    ceiling = _Ceiling(share)
    seconds = _in_turn({**steps_of_all, ONE: alone, **ceiling.calls}, steps)
    every, one = steps_of_all[name].told(), COMM.bcast(alone.told() if alone else None)
    told = ceiling.told(seconds, one["in_linear_systems"] / median(seconds[ONE]))
    ceiling.destroy()
    if alone is not None:
        alone.close()
    gained = over(seconds, ONE, name)
    return seconds, {
        "ranks": COMM.size,
        "seconds": {each: median(times) for each, times in seconds.items()},
        "speedup": gained,
        **told,
        "speedup_over_ceiling": gained / told["ceiling"],
        "steps": {name: every, ONE: one},
    }


class _Counted:
    """Takes a run's steps, and counts what is in them."""

    def __init__(self, reports: Iterator[rf.Report]) -> None:
        """Begin to count; PETSc does so already."""
        self._reports, self._event = reports, PETSc.Log.Event("KSPSolve")
        self._solving: list[float] = []
        self._steps: list[rf.Report] = []

    def __call__(self) -> None:
        """Take a step."""
        before = self._event.getPerfInfo()["time"]
        self._steps.append(next(self._reports))
        self._solving.append(self._event.getPerfInfo()["time"] - before)

    def told(self) -> dict[str, float]:
        """Time in which linear systems are solved, a median [s], and mean iterations, in a step."""
        return {
            "in_linear_systems": median(self._solving),
            "linear_iterations": mean(step.linear_iterations for step in self._steps),
            "newton": mean(step.iterations for step in self._steps),
            "tangents": mean(step.tangents for step in self._steps),
        }

    def close(self) -> None:
        """End the run."""
        self._reports.close()  # type: ignore[attr-defined]


class _Ceiling:
    """What takes part in the turns of runs, on all ranks, to tell how much faster these can be.

    Attributes:
        calls: For `_in_turn`.
    """

    def __init__(self, share: Callable[[], Made]) -> None:
        """Begin runs of a rank's share, on each rank its own. Collective.

        Args:
            share: The problem with a rank's share of the unknowns, on this rank alone.
        """
        self._vectors = [PETSc.Vec().createSeq(ENTRIES, comm=PETSc.COMM_SELF) for _ in range(3)]
        for vector in self._vectors:
            vector.set(1.0)
        w, x, y = self._vectors

        def triad() -> None:
            for _ in range(TRIADS_OF_A_TURN):
                w.waxpy(0.5, x, y)

        self._runs = [started(*share()) for _ in range(2 if COMM.rank == 0 else 1)]
        step = [partial(next, run) for run in self._runs]
        first = COMM.rank == 0
        self.calls = {
            TRIAD: triad if first else None,
            TRIADS: triad,
            ALONE: step[-1] if first else None,
            TOGETHER: step[0],
        }

    def told(self, seconds: Mapping[str, list[float]], part: float) -> dict[str, Any]:
        """Both ceilings, and what they are made of.

        Args:
            seconds: Times of `calls` [s].
            part: Of a step of one rank, in which linear systems are solved.
        """
        n = COMM.size
        size = TRIADS_OF_A_TURN * ENTRIES * BYTES / 1e9
        one, every = (size / median(seconds[name]) for name in (TRIAD, TRIADS))
        gained = min(max(n * every / one, 1.0), n)
        return {
            "ceiling": n * over(seconds, ALONE, TOGETHER),
            "ceiling_by_bandwidth": 1 / (part / gained + (1 - part) / n),
            "gigabytes_per_second": {"one core": one, "all cores": n * every},
            "part_in_linear_systems": part,
        }

    def destroy(self) -> None:
        """Free vectors and runs."""
        for vector in self._vectors:
            vector.destroy()
        for run in self._runs:
            run.close()  # type: ignore[attr-defined]

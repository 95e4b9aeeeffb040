"""Runs that take their steps in turn, so that a change of the machine's speed hits them alike."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping
from functools import partial
from statistics import median
from time import perf_counter
from typing import Any, Generic, TypeVar

import numpy as np

Name = TypeVar("Name", bound=Hashable)


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Wall time of a call [s], and what it returns."""
    start = perf_counter()
    value = call()
    return perf_counter() - start, value


def in_turn(calls: Mapping[Name, Callable[[], Any]], times: int) -> dict[Name, float]:
    """Medians of the wall times of some calls [s], each of which is made so often, in turn."""
    seconds: dict[Name, list[float]] = {name: [] for name in calls}
    for _ in range(times):
        for name, call in calls.items():
            seconds[name].append(timed(call)[0])
    return {name: median(each) for name, each in seconds.items()}


class Turns(Generic[Name]):
    """Wall times and reports of several runs; at its end, as a context, all are freed.

    Attributes:
        seconds: Wall time of each step [s], by the name of its run.
        reports: What each step has yielded.
    """

    def __init__(self, runs: Mapping[Name, Iterator[Any]], warm: int = 3) -> None:
        """Let each run go ahead.

        Args:
            runs: Name → what yields a report per step.
            warm: Reports before the first one that is timed: the initial state's and some more.
        """
        self._runs = dict(runs)
        self.seconds: dict[Name, list[float]] = {name: [] for name in runs}
        self.reports: dict[Name, list[Any]] = {name: [] for name in runs}
        for run in runs.values():
            for _ in range(warm):
                next(run)

    def __enter__(self) -> Turns[Name]:
        return self

    def __exit__(self, *_: object) -> None:
        for run in self._runs.values():
            if hasattr(run, "close"):
                run.close()

    def take(self, *names: Name) -> None:
        """One step of each run; of the named ones if any are named."""
        for name in names or self._runs:
            seconds, report = timed(partial(next, self._runs[name]))
            self.seconds[name].append(seconds)
            self.reports[name].append(report)

    def median(self, name: Name) -> float:
        """Usual time of a step [s]."""
        return median(self.seconds[name])

    def newton(self, name: Name) -> float:
        """Mean number of Newton iterations of a step."""
        return float(np.mean([report.iterations for report in self.reports[name]]))

    def per_iteration(self, name: Name) -> list[float]:
        """Time of each step over its Newton iterations [s]."""
        pairs = zip(self.seconds[name], self.reports[name], strict=True)
        return [seconds / report.iterations for seconds, report in pairs]

    def ratio(self, name: Name, to: Name, per_iteration: bool = False) -> float:
        """Median over the turns of one run's time relative to another's.

        Where the other takes one step for several, each of them is compared with it.
        """
        one, other = (
            np.array(self.per_iteration(each) if per_iteration else self.seconds[each])
            for each in (name, to)
        )
        return float(np.median(one / np.repeat(other, one.size // other.size)))

"""What all benchmarks share: a bar, runs in turn, parts of one, and processes that it starts.

Importing it makes `common`, rigidfx and the meshes of this checkout importable.
"""

import os
import subprocess
import sys
from argparse import Namespace
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, Generic, TypeVar

import numpy as np

if (demos := str(Path(__file__).resolve().parents[2])) not in sys.path:
    sys.path.insert(0, demos)

from common import Parser, chosen, conclude, write

import rigidfx as rf

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)  # Pa, 1, kg/m³
DT = 0.1  # s
PUSH = rf.Traction("x1", (0.0, 2.0, 3.0))  # Pa; on the end, sideways


LOAD = np.array([256.0, 512.0, 768.0]) / 90
ENDS = {"top": LOAD, "side": -LOAD}  # Pa; on the ends of Simo and Tarnow's L ...
RAMP = rf.Table([0.0, 2.5, 5.0], [0.0, 2.5, 0.0])  # s; ... where these are pushed and let go


def pushed_l(
    domain: rf.Domain,
    *more: rf.effects.Effect,
    material: rf.Material = MATERIAL,
    load: float = 1.0,
    time: rf.Table | None = None,
    until: float = np.inf,
    **how: Any,
) -> rf.Scene:
    """The L under so many times the tractions on its ends, which have no resultant."""
    window = {"time": time, "until": until}
    loads = [rf.Traction(end, tuple(load * t), **window) for end, t in ENDS.items()]
    return rf.Scene(domain, material, [*loads, *more], **how)


def cells_of_bar(unknowns: int) -> tuple[int, int]:
    """Cells along and across a bar ten times as long as thick with about so many unknowns."""
    across = max(1, round((unknowns / 30) ** (1 / 3)))
    return max(2, round(unknowns / (3 * (across + 1) ** 2)) - 1), across


def bar(along: int, across: int) -> rf.Domain:
    """A bar of so many cells, 1 m long each."""
    size = (along, across, across)
    return rf.box((0, 0, 0), size, size)


Name = TypeVar("Name", bound=Hashable)


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Wall time of a call [s], and what it returns."""
    start = perf_counter()
    value = call()
    return perf_counter() - start, value


class Turns(Generic[Name]):
    """Wall times and reports of several runs; at its end, as a context, all are freed.

    Attributes:
        seconds: Wall time of each step [s], by the name of its run.
        reports: What each step has yielded.
    """

    def __init__(self, runs: Mapping[Name, Iterator[Any]], warm: int = 3) -> None:
        """Let each run go ahead by so many reports: the initial state's and some more."""
        self._runs = dict(runs)
        self.seconds: dict[Name, list[float]] = {name: [] for name in runs}
        self.reports: dict[Name, list[Any]] = {name: [] for name in runs}
        for run in runs.values():
            for _ in range(warm):
                next(run)

    def __enter__(self) -> "Turns[Name]":
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


def run_parts(
    options: Namespace, parts: Mapping[str, Callable[[Namespace], dict[str, Any]]]
) -> None:
    """Run them one after the other, and write their entries as one summary."""
    summary: dict[str, Any] = {}
    for name in chosen(options, parts):
        summary |= parts[name](options)
    conclude(options.out, summary)


MINE = "OMPI_COMM", "OMPI_UNIVERSE", "PMIX_", "PMI_", "PRTE_", "HYDRA_"  # of this process in MPI


def without_mpi() -> dict[str, str]:
    """The variables that another program of MPI may see: mpirun knows of no other process here."""
    return {name: value for name, value in os.environ.items() if not name.startswith(MINE)}


def alone(call: Callable[..., Any], *given: Any) -> Any:
    """What a call returns in a process of its own, whose memory is that of the call."""
    for name in os.environ.keys() - without_mpi().keys():
        del os.environ[name]
    with ProcessPoolExecutor(1, get_context("spawn")) as other:
        return other.submit(call, *given).result()


def by_another_python(
    python: str, script: Path, given: Path, found: Path, *more: str, at_most: float | None = None
) -> dict[str, Any] | str:
    """Arrays that a script leaves in a file, run by a Python that has a code, or why it does not.

    It takes so many seconds at most, if that is said.
    """
    found.unlink(missing_ok=True)
    try:
        run = subprocess.run(
            [python, "-P", script, given, found, *more],
            env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": ""},
            capture_output=True,
            text=True,
            timeout=at_most,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"it took more than {at_most} s"
    if not found.exists():
        return "\n".join((run.stderr + run.stdout).strip().splitlines()[-8:]) or "it wrote nothing"
    with np.load(found) as arrays:
        return dict(arrays)

"""What a hard case is, how it is run, and what makes it stable.

A case is a function that yields runs, with a docstring that says which bounds the theory gives. A
run is stable if it ends without an error or a step that had to be cut, energy and momenta keep
their balances within its bounds, no step assembles more tangents than it may, and the answer is
close to a reference where there is one. A run that is to fail is stable if it fails with the
error it should.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from common import Balance
from dolfinx.mesh import compute_midpoints
from mpi4py import MPI

import rigidfx as rf

EPS = float(np.finfo(np.float64).eps)
NEWTON = 1e-12  # what a step may lose, relative: where Newton's iteration ends
ANY = 1e9  # 1/s; as a tolerance of the strain rate: every cell qualifies


class History:
    """Numbers of a run, step by step, without its fields."""

    def __init__(self, stress_at: str = "") -> None:
        """Nothing has happened yet; a probe's stress is asked for if one is named."""
        self._stress_at = stress_at
        self.stress: list[float] = []  # von Mises' there [Pa]
        self.pressing: list[float] = []  # of all contacts together [N]
        self.t: list[float] = []
        self.balance = Balance()
        self.energy: list[float] = []
        self.L: list[np.ndarray] = []
        self.J: list[np.ndarray] = []
        self.iterations: list[int] = []
        self.tangents: list[int] = []
        self.unknowns: list[int] = []
        self.cells: list[int] = []  # cells in bodies
        self.bodies: list[int] = []
        self.probes: dict[str, list[np.ndarray]] = {}
        self.events: list = []
        self.warnings: list[str] = []
        self.cuts, self.error = 0, None
        self.last: rf.Report | None = None

    def add(self, r: rf.Report) -> None:
        """Take a report over."""
        self.balance.follow(r)
        self.t.append(r.t)
        self.energy.append(r.energy)
        self.L.append(r.linear_momentum)
        self.J.append(r.angular_momentum)
        self.unknowns.append(r.unknowns)
        self.bodies.append(len(r.bodies))
        self.cells.append(sum(body.cells for body in r.bodies))
        self.events += r.events
        for name, u in r.probes.items():
            self.probes.setdefault(name, []).append(u)
        if r.step:
            self.iterations.append(r.iterations)
            self.tangents.append(r.tangents)
        self.pressing.append(sum(touch.pressing for touch in r.touches.values()))
        if self._stress_at:
            self.stress.append(r.stresses[self._stress_at].von_mises)
        self.cuts += r.cuts
        self.last = r

    def probe(self, name: str) -> np.ndarray:
        """Displacements of a probe, shape (steps + 1, 3) [m]."""
        return np.array(self.probes[name])

    def kinds(self) -> list[str]:
        """Kinds of all events."""
        return [event.kind for event in self.events]


Check = Callable[[History], str]  # "" if all is well, else what is not


@dataclass(frozen=True)
class Run:
    """One way to run a case."""

    way: str  # "flexible", "adaptive", or what else distinguishes it
    # the problem, or what makes it, where that is to fail or to warn
    scene: rf.Scene | Callable[[], rf.Scene]
    dt: float | rf.StepControl  # Δt [s], or what chooses it
    t_end: float  # end [s]
    rigidify: rf.StrainRate | rf.Accuracy | None = None  # as `simulate` has it
    energy: float = 1e-10  # bound of the energy's drift, relative
    # bound of the momenta's drift, relative; None where loads or supports act
    momentum: float | None = 1e-10
    # most tangents that a step assembles, one for each iteration of Newton's method; iterations
    # with a tangent that is kept are cheap
    tangents: int = 8
    cuts: int = 0  # how often steps may be cut, where step control is the remedy
    # whether something has to become rigid, where there is a criterion; None where either is right
    freezes: bool | None = True
    check: Check | None = None  # compares the answer with a reference
    fails: type[Exception] | None = None  # error that has to end the run
    says: tuple[str, ...] = ()  # what its message has to contain
    warns: str = ""  # what a warning of the run has to contain
    known: str = ""  # what is known to go wrong: this is in its verdict
    why: str = ""  # why it does, and what helps
    stress_at: str = ""  # probe whose stress the check asks for, if any


@dataclass(frozen=True)
class Case:
    """A hard case."""

    name: str  # its name
    group: str  # what kind of difficulty it is
    hard: str  # what makes it hard
    bound: str  # which bounds the theory gives
    runs: Callable[[bool], Iterator[Run]]  # yields its runs; takes whether they are to be short


@dataclass(frozen=True)
class Result:
    """A row of the table; numbers are the same on all ranks."""

    case: str
    group: str
    hard: str
    way: str
    steps: int
    newton_mean: float
    newton_worst: int
    energy_drift: float
    momentum_drift: float | None  # None where loads or supports act
    stable: bool
    known: bool  # whether it is known to be unstable
    cuts: int
    verdict: str  # "stable", or why not
    warnings: list[str] = field(default_factory=list)


CASES: list[Case] = []


def case(group: str, hard: str) -> Callable[[Callable], Callable]:
    """Enter a function into the list of cases; its docstring states the bounds."""

    def enter(runs: Callable[[bool], Iterator[Run]]) -> Callable[[bool], Iterator[Run]]:
        name = runs.__name__.replace("_", " ")
        CASES.append(Case(name, group, hard, " ".join((runs.__doc__ or "").split()), runs))
        return runs

    return enter


def follow(run: Run, folder: Path | None = None) -> History:
    """Carry a run out, to its end or its error, recorded in a folder if given. Collective."""
    history = History(run.stress_at)
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always", rf.RigidfxWarning)
        try:
            scene = run.scene if isinstance(run.scene, rf.Scene) else run.scene()
            with ExitStack() as stack:
                recorder = (
                    stack.enter_context(rf.Recorder(scene, folder, every=1)) if folder else None
                )
                whose = "accuracy" if isinstance(run.rigidify, rf.Accuracy) else "rigidify"
                steps = rf.simulate(scene, run.dt, run.t_end, **{whose: run.rigidify})
                for report in stack.enter_context(closing(steps)):
                    history.add(report)
                    if recorder:
                        recorder.write(report)
        except rf.RigidfxError as error:
            history.error = error
    mine = [str(w.message) for w in shown if issubclass(w.category, rf.RigidfxWarning)]
    history.warnings = MPI.COMM_WORLD.bcast(mine)
    return history


def judge(case: Case, run: Run, history: History) -> Result:
    """What has become of a run."""
    problems = []
    if run.fails is None and history.error is not None:
        problems.append(f"{type(history.error).__name__}: {history.error}")
    elif run.fails is not None:
        message = str(history.error)
        if not isinstance(history.error, run.fails):
            problems.append(f"ended with {history.error!r}, not with {run.fails.__name__}")
        problems += [f"its message lacks {text!r}: {message}" for text in run.says
                     if text not in message]  # fmt: skip
    energy, drifts = history.balance.energy, history.balance.momenta
    momentum = max(drifts) if history.t and run.momentum is not None else None
    worst = max(history.tangents, default=0)
    if not energy <= run.energy:
        problems.append(f"energy is off by {energy:.1e} > {run.energy:.0e}")
    if momentum is not None and run.momentum is not None and not momentum <= run.momentum:
        problems.append(f"momenta are off by {momentum:.1e} > {run.momentum:.0e}")
    if worst > run.tangents:
        problems.append(f"a step took {worst} > {run.tangents} tangents")
    if history.cuts > run.cuts and run.fails is None:
        problems.append(f"steps were cut {history.cuts} times")
    found_rigid = max(history.cells, default=0) > 0
    if run.rigidify is not None and run.freezes not in (None, found_rigid):
        problems.append("nothing has become rigid" if run.freezes else "there are bodies")
    lost = [text for text in history.warnings if "balance of energy" in text]
    if lost and not run.warns:
        problems.append(lost[0])
    if run.warns and not any(run.warns in text for text in history.warnings):
        problems.append(f"no warning says {run.warns!r}")
    if run.check is not None and history.t and not problems:
        found = run.check(history)
        problems += [found] if found else []
    if run.known and run.known in "; ".join(problems):
        problems = [f"{problem} (known: {run.why})" for problem in problems]
    return Result(
        case=case.name,
        group=case.group,
        hard=case.hard,
        way=run.way,
        steps=len(history.iterations),
        newton_mean=float(np.mean(history.iterations)) if history.iterations else 0.0,
        newton_worst=max(history.iterations, default=0),
        energy_drift=energy,
        momentum_drift=momentum,
        stable=not problems,
        known=bool(run.known),
        cuts=history.cuts,
        verdict="; ".join(problems) or "stable",
        warnings=history.warnings,
    )


def carry_out(case: Case, short: bool) -> Iterator[Result]:
    """Run a case in all its ways. Collective."""
    # What a run is compared with may be known only once the one before has been judged.
    for run in case.runs(short):
        yield judge(case, run, follow(run))


# What several cases share ----------------------------------------------------------------------


def near(name: str, value: float, reference: float, tolerance: float) -> str:
    """Whether a value is close to a reference; "" if so."""
    error = abs(value / reference - 1)
    return "" if error <= tolerance else f"{name} is {value:.6g}, not {reference:.6g}"


def few_freezes(history: History) -> str:
    """Whether of windows of two steps some log₂ of their number ended in a freeze; "" if so."""
    freezes, n = history.kinds().count("freeze"), len(history.iterations)
    return "" if 0 < freezes <= np.log2(n / 2) + 2 else f"{freezes} freezes in {n} steps"


def between(low: float, high: float, axis: int = 0) -> Callable[[np.ndarray], np.ndarray]:
    """A marker of a slice across an axis."""
    slack = 1e-9 * max(abs(low), abs(high))
    return lambda x: (x[axis] >= low - slack) & (x[axis] <= high + slack)


def middles(domain: rf.Domain) -> np.ndarray:
    """Middles of all local cells, ghosts included, shape (cells, 3) [m]."""
    cells = domain.mesh.topology.index_map(3)
    every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    return compute_midpoints(domain.mesh, 3, every)


def both(
    scene: rf.Scene, dt: float, t_end: float, rule: rf.StrainRate, name: str = "", **how: Any
) -> Iterator[Run]:
    """A run that is all flexible, and one in which parts become rigid by a rule."""
    begin = f"{name}, " if name else ""
    yield Run(f"{begin}flexible", scene, dt, t_end, **how)
    yield Run(f"{begin}adaptive", scene, dt, t_end, rule, **how)


def release_at(*times: float) -> rf.Release:
    """A planned release."""
    return rf.Release(at=times)

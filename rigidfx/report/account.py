"""Messages of a run (`rigidfx.base.log`): its place once a minute, and at its end what it saved.

Savings by rigid parts follow from the times of steps.
"""

from __future__ import annotations

from datetime import timedelta
from statistics import fmean
from time import perf_counter
from typing import ClassVar

from mpi4py import MPI

from rigidfx.base.form_cache import SPENT
from rigidfx.base.log import folders, remind, tell
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

FEWEST = 10  # steps of a kind, from which on their mean is told


class Whereabouts:
    """Follows a run, and says on rank 0 how far it is and how long it may still take."""

    def __init__(self, comm: MPI.Intracomm, t_end: float) -> None:
        self._comm, self._t_end = comm, t_end
        self._began = self._told = perf_counter()  # of the run; when something was said
        self._first: float | None = None  # time of the first report [s]

    def follow(self, report: Report) -> None:
        """Record a report."""
        if self._first is None:
            self._first = report.t
        now = perf_counter()
        if now - self._told < timedelta(minutes=1).total_seconds():
            return
        self._told, took, done = now, now - self._began, report.t - self._first
        left = ""
        if done > 0:
            more = timedelta(seconds=round((self._t_end - report.t) * took / done))
            left = f", about {more} left"
        where = f"t = {report.t:.4g} of {self._t_end:.4g} s ({report.t / self._t_end:.0%})"
        after = f"after {timedelta(seconds=round(took))}: step {report.step}"
        remind(self._comm, f"{where} {after}, {report.unknowns} unknowns{left}")


class Pay:
    """Compares steps with parts that were found to be rigid with steps without.

    Steps with such parts are all in which they are, or change. Their time contains switches and
    growth, and neither kind contains compilations, which are made once for many runs. Parts named
    `Rigid` are rigid in both kinds.
    """

    remembered: ClassVar[Remembered] = same(
        *("_most", "_flexible", "_rigid", "_switching", "_spared", "_time"),
        *("_bodies", "_named", "_fewest"),
    )

    def __init__(self) -> None:
        self._most = 0  # unknowns
        self._flexible: list[float] = []  # wall time of steps without bodies [s] ...
        self._rigid: list[float] = []  # ... with bodies ...
        self._switching = 0.0  # ... and of those of them in which bodies changed
        self._spared = self._time = 0.0  # ∫ unknowns dt, of bodies and of all [s]
        self._bodies = self._named = False  # whether there are any, found and named
        self._fewest: int | None = None  # cells of bodies, those named
        self._compiled = len(SPENT)

    def follow(self, report: Report) -> None:
        """Record a report."""
        wall = report.wall - sum(SPENT[self._compiled :])
        self._compiled = len(SPENT)
        self._most = max(self._most, report.unknowns)
        records = report.rigid.of.records
        cells = sum(body.size for body in records)  # a body found may have a named part's name
        self._fewest = cells if self._fewest is None else min(self._fewest, cells)
        before, self._bodies = self._bodies, cells > self._fewest
        self._named |= any(body.named for body in records)
        if not report.step:
            return
        self._time += report.dt * self._most
        self._spared += report.dt * (self._most - report.unknowns)
        (self._rigid if before or report.events else self._flexible).append(wall)
        if report.events:
            self._switching += wall

    @property
    def _ratio(self) -> float:
        """Time of a step with bodies over that of one without; zero where it is not known."""
        if min(len(self._flexible), len(self._rigid)) < FEWEST:
            return 0.0
        return fmean(self._rigid) / fmean(self._flexible)

    @property
    def loses(self) -> bool:
        """Whether steps with bodies have taken longer."""
        return self._ratio > 1

    def told(self) -> str:
        """A line, empty where nothing was rigid."""
        if not self._rigid:
            return (
                "rigid parts: those named Rigid are so in all steps, so that there is none to "
                "compare with"
                if self._named
                else ""
            )
        parts = [f"rigid parts: {self._spared / self._time:.0%} of unknowns × time"]
        if self._ratio > 0:
            dear = ", which does not pay" if self.loses else ""
            parts.append(f"a step with them took {self._ratio:.2f} of one without{dear}")
        if self._switching > 0:
            share = self._switching / (sum(self._flexible) + sum(self._rigid))
            parts.append(f"steps with a switch took {share:.0%} of the time")
        return "; ".join(parts)


def beginning(scene: Scene, unknowns: int, t_end: float, took: float) -> str:
    """The line with which a run begins; forms and initial state took some time [s]."""
    return f"{scene!r}: ready after {took:.1f} s; {unknowns} unknowns, to t = {t_end:g} s"


class Account:
    """Tells of switches and cuts of steps, and at the end of the cost."""

    remembered: ClassVar[Remembered] = same("_steps", "_iterations", "_switches") | {"_pay": PART}

    def __init__(self, comm: MPI.Intracomm, t_end: float) -> None:
        self._comm, self._t_end = comm, t_end
        self._whereabouts = Whereabouts(comm, t_end)
        self._steps = self._iterations = self._switches = 0
        self._began = perf_counter()
        self._last: Report | None = None
        self._pay = Pay()

    def follow(self, report: Report) -> None:
        """Record a report."""
        self._last = report
        self._whereabouts.follow(report)
        self._pay.follow(report)
        self._steps += report.step > 0
        self._iterations += report.iterations
        for event in report.events:
            self._switches += 1
            names = ", ".join(change.name for change in event.changes[:4])
            more = " …" if len(event.changes) > 4 else ""
            numbers = f"{event.unknowns_before} → {event.unknowns_after} unknowns"
            tell(self._comm, f"t = {event.t:.6g} s: {event.kind} ({names}{more}): {numbers}")
        if report.cuts:
            tell(self._comm, f"t = {report.t:.6g} s: the step was cut {report.cuts} times")

    def __enter__(self) -> Account:
        return self

    def __exit__(self, kind: object, *of_error: object) -> None:
        """Say how the run ended, and its cost."""
        last, took = self._last, perf_counter() - self._began
        if last is None:
            return
        if paid := self._pay.told():
            (remind if self._pay.loses else tell)(self._comm, paid)
        # A loop over several runs leaves those that are at their ends when the first one is over.
        left = kind is GeneratorExit and last.t >= self._t_end
        how = "stopped" if kind is not None and not left else "done"
        parts = [
            f"'{body.name}' of {body.cells} cells"
            + (f" with {body.q.size} shapes" if body.q.size else "")
            for body in last.bodies[:4]
        ]
        parts += [f"{len(last.bodies) - 4} more"] if len(last.bodies) > 4 else []
        rigid = f"rigid: {', '.join(parts)}" if parts else "nothing is rigid"
        places = ", ".join(map(str, folders()))
        where = f"; results in {places}" if places else ""
        tell(
            self._comm,
            f"{how} at t = {last.t:.6g} s: {self._steps} steps, {self._iterations} iterations, "
            f"{took:.1f} s; {self._switches} switches, {rigid}, {last.unknowns} unknowns{where}",
        )

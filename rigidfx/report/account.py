"""Messages of a run as it goes on and at its end: see `rigidfx.base.log`."""

from __future__ import annotations

from time import perf_counter
from typing import ClassVar

from mpi4py import MPI

from rigidfx.base.log import folders, remind, tell
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.report.pay import Pay
from rigidfx.report.report import Report
from rigidfx.report.whereabouts import Whereabouts
from rigidfx.scene.scene import Scene

__all__ = ["Account", "beginning"]


def beginning(scene: Scene, unknowns: int, t_end: float, took: float) -> str:
    """The line with which a run begins.

    Args:
        scene: The problem.
        unknowns: Number of unknowns.
        t_end: End of the run [s].
        took: Time that forms and initial state took [s].
    """
    return f"{scene!r}: ready after {took:.1f} s; {unknowns} unknowns, to t = {t_end:g} s"


class Account:
    """Tells of switches and cuts of steps, and at the end of the cost."""

    remembered: ClassVar[Remembered] = same("_steps", "_iterations", "_switches") | {"_pay": PART}

    def __init__(self, comm: MPI.Intracomm, t_end: float) -> None:
        """Begin.

        Args:
            comm: Ranks of the run.
            t_end: Its end [s].
        """
        self._comm, self._t_end = comm, t_end
        self._whereabouts = Whereabouts(comm, t_end)
        self._steps = self._iterations = self._switches = 0
        self._began = perf_counter()
        self._last: Report | None = None
        self._pay = Pay()

    def follow(self, report: Report) -> None:
        """Take note of a report."""
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
        """Nothing to do."""
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

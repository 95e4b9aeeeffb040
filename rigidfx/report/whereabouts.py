"""Says once a minute where a run is, also where standard error is no terminal."""

from __future__ import annotations

from datetime import timedelta
from time import perf_counter

from mpi4py import MPI

from rigidfx.base.log import remind
from rigidfx.report.report import Report

__all__ = ["Whereabouts"]


class Whereabouts:
    """Follows a run, and says on rank 0 how far it is and how long it may still take."""

    def __init__(self, comm: MPI.Intracomm, t_end: float) -> None:
        """Begin.

        Args:
            comm: Ranks of the run.
            t_end: Its end [s].
        """
        self._comm, self._t_end = comm, t_end
        self._began = self._told = perf_counter()  # of the run; when something was said
        self._first: float | None = None  # time of the first report [s]

    def follow(self, report: Report) -> None:
        """Take note of a report."""
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

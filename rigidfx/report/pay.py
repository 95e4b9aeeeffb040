"""Savings by rigid parts in a run, by the times of its steps."""

from __future__ import annotations

from statistics import median
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.report.report import Report

__all__ = ["Pay"]

FEWEST = 10  # steps of a kind, from which on their median is told


class Pay:
    """Compares steps with bodies with steps without."""

    remembered: ClassVar[Remembered] = same(
        "_most", "_flexible", "_rigid", "_switching", "_spared", "_time", "_bodies"
    )

    def __init__(self) -> None:
        """Nothing has happened."""
        self._most = 0  # unknowns
        self._flexible: list[float] = []  # wall time of steps without bodies [s] ...
        self._rigid: list[float] = []  # ... with bodies ...
        self._switching = 0.0  # ... and of all in which bodies changed
        self._spared = self._time = 0.0  # ∫ unknowns dt, of bodies and of all [s]
        self._bodies = False  # before the present step

    def follow(self, report: Report) -> None:
        """Take note of a report."""
        self._most = max(self._most, report.unknowns)
        bodies, self._bodies = self._bodies, bool(report.bodies)
        if not report.step:
            return
        self._time += report.dt * self._most
        self._spared += report.dt * (self._most - report.unknowns)
        if report.events:
            self._switching += report.wall
        else:
            (self._rigid if bodies else self._flexible).append(report.wall)

    @property
    def _ratio(self) -> float:
        """Time of a step with bodies over that of one without; zero where it is not known."""
        if min(len(self._flexible), len(self._rigid)) < FEWEST:
            return 0.0
        return median(self._rigid) / median(self._flexible)

    @property
    def loses(self) -> bool:
        """Whether steps with bodies have taken longer."""
        return self._ratio > 1

    def told(self) -> str:
        """A line, empty where nothing was rigid."""
        if not self._spared > 0:
            return ""
        every = sum(self._flexible) + sum(self._rigid) + self._switching
        parts = [f"rigid parts: {self._spared / self._time:.0%} of unknowns × time"]
        if self._ratio > 0:
            dear = ", which does not pay" if self.loses else ""
            parts.append(f"a step with them took {self._ratio:.2f} of one without{dear}")
        if every > 0:
            parts.append(f"steps with a switch took {self._switching / every:.0%} of the time")
        return "; ".join(parts)

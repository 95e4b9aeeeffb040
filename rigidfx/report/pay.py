"""Savings by rigid parts in a run, by the times of its steps."""

from __future__ import annotations

from statistics import fmean
from typing import ClassVar

from rigidfx.base.form_cache import SPENT
from rigidfx.base.remembered import Remembered, same
from rigidfx.report.report import Report

__all__ = ["Pay"]

FEWEST = 10  # steps of a kind, from which on their mean is told


class Pay:
    """Compares steps with parts that were found to be rigid with steps without.

    Steps with such parts are all in which they are, or change. Their time contains switches and the
    error motion, and neither kind contains compilations, which are made once for many runs. Parts
    named `Rigid` are rigid in both kinds.
    """

    remembered: ClassVar[Remembered] = same(
        "_most",
        "_flexible",
        "_rigid",
        "_switching",
        "_spared",
        "_time",
        "_bodies",
        "_named",
        "_fewest",
    )

    def __init__(self) -> None:
        """Nothing has happened."""
        self._most = 0  # unknowns
        self._flexible: list[float] = []  # wall time of steps without bodies [s] ...
        self._rigid: list[float] = []  # ... with bodies ...
        self._switching = 0.0  # ... and of those of them in which bodies changed
        self._spared = self._time = 0.0  # ∫ unknowns dt, of bodies and of all [s]
        self._bodies = self._named = False  # whether there are any, found and named
        self._fewest: int | None = None  # cells of bodies, those named
        self._compiled = len(SPENT)

    def follow(self, report: Report) -> None:
        """Take note of a report."""
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

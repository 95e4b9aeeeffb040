"""A run with parts that become rigid and, beside it, the same without, step by step."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rigidfx.base.errors import SceneError
from rigidfx.command.kept_run import KeptRun
from rigidfx.command.parser import say
from rigidfx.command.reports import line_of
from rigidfx.decide.criteria.criterion import StrainRate
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["Pair"]

SAME = 1e-9  # relative difference of times that are one


class Pair:
    """Two runs that go on together, so that a change of the machine's speed hits them alike.

    It is a context, at the end of which both are freed, and iterates over the reports of the
    adaptive run; its freezes and releases are printed where no terminal shows those of its log.

    Attributes:
        adaptive: Reports so far.
        flexible: Those of the fully flexible run, which is never behind; none if not wanted.
        notes: What is noted of each report of the adaptive run ...
        notes_beside: ... and of the flexible one.
    """

    def __init__(
        self,
        scene: Scene,
        dt: float | Mapping[float, float],
        t_end: float,
        rigidify: StrainRate,
        compare: bool = True,
        beside: StrainRate | None = None,
        *,
        folder: Path | None = None,
        resume: bool = False,
        note: Callable[[Report], Any] = lambda report: None,
        note_beside: Callable[[Report], Any] = lambda report: None,
    ) -> None:
        """Set the runs up, as of `rigidfx.simulate`; without `compare` there is one only.

        One of tolerance zero in `beside` has the strain rates of the flexible run measured. With a
        folder both leave checkpoints there, and may `resume`; see `KeptRun` for this and for notes.

        Raises:
            SceneError: On every rank, if there is nothing to go on from.
        """
        kept: dict[str, Any] = {"resume": resume, "rigidify": rigidify, "progress": True}
        self._ahead = KeptRun(folder, scene, dt, t_end, note=note, **kept)
        if resume and not self._ahead.goes_on:
            self._ahead.close()
            raise SceneError(f"There is no checkpoint in '{folder}'. Begin without going on.")
        self._beside: KeptRun | None = None
        if compare:
            place = None if folder is None else folder / "flexible"
            kept |= {"rigidify": beside, "progress": False}
            self._beside = KeptRun(place, scene, dt, t_end, note=note_beside, **kept)
        self.adaptive, self.notes = self._ahead.reports, self._ahead.notes
        none: tuple[list[Report], list[Any]] = [], []
        twin = self._beside
        self.flexible, self.notes_beside = (twin.reports, twin.notes) if twin else none

    def __enter__(self) -> Pair:
        """The two runs."""
        return self

    def __exit__(self, *_: object) -> None:
        """Free both."""
        self._ahead.close()
        if self._beside is not None:
            self._beside.close()

    def __iter__(self) -> Iterator[Report]:
        """Reports of the adaptive run; the other one goes on beside it."""
        for report in self._ahead:
            # A step that was cut has reports at times that the other run has not.
            while self._beside is not None and self._is_behind(report.t):
                next(self._beside)
            for event in () if sys.stderr.isatty() else report.events:
                say(line_of(event))
            yield report

    def matched(self) -> list[tuple[Report, Report]]:
        """Reports of both runs at the same times: those of cut steps are in one only."""
        out, ahead, beside = [], iter(self.adaptive), iter(self.flexible)
        a, b = next(ahead, None), next(beside, None)
        while a is not None and b is not None:
            if abs(a.t - b.t) <= SAME * max(a.t, b.t):
                out.append((a, b))
                a, b = next(ahead, None), next(beside, None)
            elif a.t < b.t:
                a = next(ahead, None)
            else:
                b = next(beside, None)
        return out

    def _is_behind(self, t: float) -> bool:
        return not self.flexible or self.flexible[-1].t < t * (1 - SAME)

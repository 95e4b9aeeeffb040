"""A run with parts that become rigid and, beside it, the same without, step by step.

Reports are kept in a file beside checkpoints, so that a run goes on with all of them. Their
freezes, releases and curves against time are told.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from math import nan
from pathlib import Path
from typing import Any, cast

import numpy as np

from rigidfx.base.errors import SceneError, on_rank_0
from rigidfx.base.types import TINY
from rigidfx.checkpoint.files import dumped, loaded
from rigidfx.checkpoint.keeper import Checkpoint
from rigidfx.command.options import say
from rigidfx.decide.settings import StrainRate
from rigidfx.plot import Curve
from rigidfx.report.events import Event
from rigidfx.report.report import Report, Source
from rigidfx.scene.scene import Scene
from rigidfx.simulation import resume as gone_on
from rigidfx.simulation import simulate

SAME = 1e-9  # relative difference of times that are one


def events_of(reports: Iterable[Report]) -> list[Event]:
    """All events of a run."""
    return [event for report in reports for event in report.events]


def freezes_of(reports: Iterable[Report]) -> list[Event]:
    """Those by which something became rigid."""
    return [event for event in events_of(reports) if event.kind == "freeze"]


def energy_jump(reports: Sequence[Report]) -> float:
    """The most that any event lost or gained, relative to the largest energy of the run."""
    largest = max(r.energy for r in reports)
    lost = max((abs(event.energy_lost) for event in events_of(reports)), default=0.0)
    return lost / max(largest, TINY)


def energy_drift(reports: Sequence[Report]) -> float:
    """Largest error of the balance of energy, relative to the largest energy of the run."""
    energy = np.array([r.energy for r in reports])
    off = energy - np.cumsum([r.supplied for r in reports])
    return float(np.abs(off - off[0]).max() / max(float(energy.max()), TINY))


def line_of(event: Event) -> str:
    """An event in a line."""
    cells = sum(change.cells_after - change.cells_before for change in event.changes)
    return (
        f"t = {event.t:.4g} s: {event.kind} of {abs(cells)} cells, {event.unknowns_before} → "
        f"{event.unknowns_after} unknowns, {event.energy_frozen + event.energy_released:.3g} J "
        f"moved, {event.energy_lost:.1e} J lost ({event.reason})"
    )


def curve(label: str, reports: Sequence[Report], name: str) -> Curve:
    """A number of the reports, by its name, against time."""
    return Curve(label, [r.t for r in reports], [getattr(r, name) for r in reports])


class _Past:
    """The state of a report that was read from a file: the run has gone on since."""

    changes, t = None, nan


class KeptRun(Iterator[Report]):
    """A run that leaves a checkpoint a minute in a folder, and its reports in `reports.rfx` there.

    Attributes:
        reports: Reports so far. Those of before a checkpoint have their numbers, no state.
        notes: What `note` has said of each of them.
        goes_on: Whether the run goes on from a checkpoint.
    """

    def __init__(
        self,
        folder: str | Path | None,
        scene: Scene,
        dt: float | Mapping[float, float],
        t_end: float,
        *,
        resume: bool = False,
        note: Callable[[Report], Any] = lambda report: None,
        progress: bool | None = None,
        **how: Any,
    ) -> None:
        """Begin the run, or go on with it if there is a checkpoint. Collective.

        Without a folder nothing is kept. `note` finds, while the state of a report is there,
        numbers and arrays, which are taken from rank 0; it is collective. Of `how` the run has
        `rigidify` and `petsc_options`; all else is as of `rigidfx.simulate`.
        """
        self.reports: list[Report] = []
        self.notes: list[Any] = []
        self._comm, self._note = scene.comm, note
        self._path = None if folder is None else Path(folder) / "reports.rfx"
        found = resume and folder is not None and any(Path(folder).glob("checkpoint-*.rfx"))
        self.goes_on: bool = scene.comm.bcast(found)
        self._first: Report | None = None
        if self.goes_on and self._path is not None:
            again: dict[str, Any] = {"dt": dt, "t_end": t_end, "rigidify": how.get("rigidify")}
            self._steps = gone_on(self._path.parent, scene, progress=progress, **again)
            self._first = next(self._steps, None)
            self._read(self._path)
            return
        left = None if folder is None else Checkpoint(folder)
        self._steps = simulate(scene, dt, t_end, progress=progress, checkpoint=left, **how)
        if self._path is not None:
            self._write(self._path, bytes, "wb")

    def __next__(self) -> Report:
        report = next(self._steps) if self._first is None else self._first
        self._first = None
        self.reports.append(report)
        self.notes.append(self._note(report))
        if self._path is not None:
            self._write(self._path, lambda: _record(report, self.notes[-1]), "ab")
        return report

    def close(self) -> None:
        """Free what the run holds."""
        cast(Any, self._steps).close()

    def _write(self, path: Path, data: Callable[[], bytes], mode: str) -> None:
        """Write to the file on rank 0. Collective."""

        def write() -> None:
            with path.open(mode) as file:
                file.write(data())

        on_rank_0(self._comm, write, lambda error: f"cannot write '{path}' ({error}).")

    def _read(self, path: Path) -> None:
        """Read the reports of before the checkpoint, and cut off what came later. Collective."""
        before = None if self._first is None else self._first.step

        def read() -> list[bytes]:
            records, end, data = list[bytes](), 0, path.read_bytes()
            while end < len(data) and (before is None or len(records) < before):
                begin = data.index(b"\n", end) + 1
                end = begin + int(data[end:begin])
                records.append(data[begin:end])
            os.truncate(path, end)
            return records

        records = on_rank_0(self._comm, read, lambda error: f"cannot read '{path}' ({error}).")
        for record in records:
            report, note = _report_of(record)
            self.reports.append(report)
            self.notes.append(note)
        if before is not None and len(records) != before:
            raise SceneError(
                f"'{path}' has {len(records)} reports of the {before} before the checkpoint. Begin "
                "anew, without going on."
            )


def _record(report: Report, note: Any) -> bytes:
    """The numbers of a report, and what is noted of it, behind their length."""
    names = (field.name for field in fields(report))
    out = {name: getattr(report, name) for name in names if not name.startswith("_")}
    joints: Any = dict(report.joints)
    out |= {"rigid": None, "result": replace(report.result, joints=joints)}
    for more in ({}, {"ledger": None}):  # one that holds a function is left out
        data = dumped((out | more, report.bodies, note))
        if data is not None:
            return b"%d\n" % len(data) + data
    raise ValueError("a note has to be made of numbers, texts and arrays")


def _report_of(data: bytes) -> tuple[Report, Any]:
    """A report from its numbers, and what was noted of it."""
    numbers, bodies, note = loaded(data)
    gone: Any = _Past()
    report = Report(**numbers, _source=Source(gone, 0, None, gone, None, None))
    vars(report)["bodies"] = bodies  # in the place of what would be made of `rigid`
    return report, note


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
        """Set the runs up, as of `KeptRun`; without `compare` there is one only.

        One of tolerance zero in `beside` has the strain rates of the flexible run measured. Raise
        `SceneError` on every rank if there is nothing to go on from.
        """
        self._scene = scene
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
        return self

    def __exit__(self, *_: object) -> None:
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
        times = np.array([report.t for report in self.flexible])
        out = []
        for report in self.adaptive if len(times) else ():
            k = int(np.abs(times - report.t).argmin())
            if abs(times[k] - report.t) <= SAME * max(report.t, times[k]):
                out.append((report, self.flexible[k]))
        return out

    @property
    def runs(self) -> dict[str, list[Report]]:
        """Reports by the names of the runs that there are."""
        both = {"adaptive": self.adaptive, "all flexible": self.flexible}
        return {name: reports for name, reports in both.items() if reports}

    def curves(self, name: str) -> list[Curve]:
        """A number of the reports, by its name, against time, of each run."""
        return [curve(label, reports, name) for label, reports in self.runs.items()]

    def summary(self) -> dict[str, Any]:
        """Numbers of any two runs, as JSON takes them."""
        reports, freezes = self.adaptive, freezes_of(self.adaptive)
        wall, beside = (sum(r.wall for r in of) for of in (reports, self.flexible))
        return {
            "cells": int(self._scene.mesh.topology.index_map(3).size_global),
            "unknowns_start": reports[0].unknowns,
            "unknowns_end": min(r.unknowns for r in reports),
            "steps": len(reports) - 1,
            "first_rigid_time": freezes[0].t if freezes else None,
            "events": [f"{e.t:.4g} s: {e.kind} ({e.reason})" for e in events_of(reports)],
            "energy_jump": energy_jump(reports),
            "energy_drift": energy_drift(reports),
            "wall_adaptive_s": wall,
            "wall_flexible_s": beside if self.flexible else None,
            "time_ratio": wall / beside if self.flexible else None,
            "ranks": self._scene.comm.size,
        }

    def _is_behind(self, t: float) -> bool:
        return not self.flexible or self.flexible[-1].t < t * (1 - SAME)

"""The files of a run: a row per step in history.csv, and fields for ParaView.

docs/results.md lists the files, docs/columns.md the columns of tables and the fields.

A run may end at any instant, by Ctrl-C or kill -9: each file is whole up to the last row or time
that was written. While it goes on no other recorder gets the folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import floor
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from rigidfx.base.errors import OutputError, SceneError, StepError, on_rank_0, together
from rigidfx.base.inputs import names, path_of, positive, truth, whole
from rigidfx.base.instants import at_latest
from rigidfx.base.taken import check_same
from rigidfx.output.fields import Fields, clouds_of
from rigidfx.output.history import Written, history_row
from rigidfx.output.paraview import Body, Cloud
from rigidfx.output.run_files import RunFiles, body_rows, event_rows, kinds_of
from rigidfx.output.whole_writes import ChangedFile
from rigidfx.report.peaks import Peaks
from rigidfx.report.report import Report
from rigidfx.report.start import check_report, check_scene
from rigidfx.scene.scene import Scene


class Recorder:
    """Writes the reports of a run into a folder; a context manager.

    Only rank 0 writes. With the first report, files of a former run under the same names are
    replaced; where the run goes on from a checkpoint (`resume`), the files that it had written go
    on from where they ended there, without rows written later.

    Example:
        >>> with Recorder(scene, "out/frame", interval=0.1) as recorder:   # doctest: +SKIP
        ...     for report in simulate(scene, dt=0.01, t_end=2.4):
        ...         recorder.write(report)

    Attributes:
        folder: Where the files are.
    """

    def __init__(
        self,
        scene: Scene,
        folder: str | Path,
        *,
        every: int = 10,
        interval: float | None = None,
        stress: bool = True,
        integration_points: bool = False,
        format: Literal["pvd", "vtkhdf", "both"] = "pvd",
        peaks: Sequence[str] = (),
        resume: bool | None = None,
    ) -> None:
        """Make the folder and lock history.csv. Collective.

        Args:
            scene: The problem that is run.
            folder: Folder for the output; made if it does not exist. That of rank 0 counts.
            every: Number of steps from one output of the fields to the next, so that output is a
                small part of the run; history.csv has a row for each step in any case ...
            interval: ... or, if given, at the first step that ends at or after each multiple of
                this time [s]. The last state is written in any case.
            stress: Whether stresses and strains are among the fields, and those at probes in
                history.csv. If not, none is computed or compiled.
            integration_points: Whether points.pvd is written, stress and strain where they are
                computed, neither extrapolated nor averaged.
            format: Which files have the fields: "pvd", a .vtu for each time; "vtkhdf", one file for
                all times, of less than half the size, which ParaView 5.12 and h5py can read; or
                "both".
            resume: Whether files go on, if they are not to do so where the run does: True refuses a
                run that goes on from no checkpoint, False begins anew in any case.
            peaks: Names of sets of facets, cells, edges or vertices: history.csv tells the largest
                von Mises stress over each, and where it is, at the cost of the cells there.

        Raises:
            OutputError: On every rank, if the folder cannot be written to, or another recorder
                writes to it.
            SceneError: On every rank, if an argument cannot be used, or is not the same on all
                ranks; or if there is no h5py for a .vtkhdf.
        """
        check_scene("Recorder", scene)
        given: dict[str, object] = {"every": every, "interval": interval, "stress": stress}
        given |= {"integration_points": integration_points, "format": format, "peaks": peaks}
        given["resume"] = resume
        check_same(scene.comm, "Recorder", given)
        for name in ("stress", "integration_points", "resume"):
            if given[name] is not None or name != "resume":
                truth("Recorder", name, given[name])
        self._kinds = kinds_of(format)
        over = tuple(dict.fromkeys(names("Recorder", "peaks", peaks, "sets of the mesh")))
        if over and not stress:
            raise SceneError("Recorder: peaks are of stresses, which stress=False leaves out.")
        self._every = whole("Recorder", "every", every, least=1)
        self._interval = None if interval is None else positive("Recorder", "interval", interval)
        self._next = 0.0
        self.folder = scene.comm.bcast(
            together(scene.comm, "Recorder", lambda: path_of("Recorder", "folder", folder))
        )
        self._scene, self._comm = scene, scene.comm
        self._stress = bool(stress)
        self._fields = Fields(scene, self._stress)
        self._clouds = clouds_of(scene, bool(integration_points))
        self._peaks = Peaks(scene, over, "Recorder") if over else None
        self._last: Report | None = None
        self._before: Written | None = None
        self._fields_at, self._closed = -1, False
        self._begun, self._resume = False, resume
        self._files: RunFiles  # on rank 0
        self._open()

    def _open(self) -> None:
        """Open the files; none changes yet. Collective."""
        bodies: dict[str, Body | Cloud] = {"fields": self._fields.body}
        bodies |= {name: cloud.body for name, cloud in self._clouds.items()}

        def opened() -> None:
            self._files = RunFiles(self.folder, self._kinds, bodies)

        self._on_first_rank(opened)
        own = os.path.realpath(self.folder), self._comm.rank == 0 and self._files.former
        self._place, self._former = self._comm.bcast(own)

    @property
    def name(self) -> str:
        """The folder, for checkpoints."""
        return self._place

    def ends(self) -> Mapping[str, Any] | None:
        """Where files end, and their memory, for checkpoints; on rank 0, else None."""
        if self._comm.rank:
            return None
        own = {"next": self._next, "fields_at": self._fields_at, "before": self._before}
        return self._files.ends() | own

    def _begin(self, report: Report) -> None:
        """Begin the files, or go on where they ended at the checkpoint. Collective."""
        writers = report._writers
        ends = None if self._resume is False else writers.known(self.name)
        if ends is None and self._resume:
            raise SceneError(
                f"Recorder: resume=True goes on with the files of a run of `resume` that a "
                f"recorder of '{self.folder}' had written before the checkpoint. Leave resume out, "
                "or name that folder."
            )
        if ends is None and self._resume is None and writers.goes_on and self._former:
            raise SceneError(
                f"Recorder: the run goes on from a checkpoint that does not know '{self.folder}', "
                "where there are results. Name the folder that the run had, or a new one; "
                "resume=False replaces these results."
            )
        if ends is not None:
            self._next, self._fields_at, self._before = (
                ends[name] for name in ("next", "fields_at", "before")
            )
        self._on_first_rank(lambda: self._files.begin(ends or {}))
        self._begun = True

    @property
    def history(self) -> Path:
        """Path of history.csv."""
        return self.folder / "history.csv"

    @property
    def events(self) -> Path:
        """Path of events.csv."""
        return self.folder / "events.csv"

    @property
    def bodies(self) -> Path:
        """Path of bodies.csv."""
        return self.folder / "bodies.csv"

    @property
    def series(self) -> Path:
        """Path of the fields for ParaView; of the .pvd where there is a .vtkhdf, too."""
        return self.folder / f"fields.{self._kinds[0]}"

    def write(self, report: Report) -> None:
        """Add a row, and the fields where their time has come. Collective.

        Args:
            report: The last step of the run so far.

        Raises:
            OutputError: On every rank, if rank 0 cannot write.
            SceneError: If it is no report, of another scene, of a step that is not the last one any
                more, or earlier than the last row.
        """
        self._check(report)
        if not self._begun:
            self._begin(report)
        report._writers.join(self)
        self._last, before = report, self._before
        self._before = Written(report.step, report.t, dict(report.velocities))
        stresses = report.stresses if self._stress else {}
        peaks = self._peaks.measure(report) if self._peaks else {}
        row = history_row(self._scene, report, stresses, peaks, before)

        def write() -> None:
            self._files.rows("history").add([row])
            if report.finds_bodies:
                self._files.rows("events").add(event_rows(report))

        self._on_first_rank(write)
        if self._due(report):
            self._write_fields(report)

    def complete(self) -> None:
        """Write the fields of the last step, unless they are there or the run has gone on.

        A run that leaves checkpoints calls this before the one of its end. Collective.
        """
        last = self._last
        if last and not self._closed and last.step != self._fields_at and last.current:
            self._write_fields(last)

    def close(self) -> None:
        """Close the files, and let other recorders have the folder. Collective.

        Raises:
            OutputError: On every rank, if the file system has not been able to keep all data; the
                files are closed all the same.
        """
        self._closed = True
        self._on_first_rank(self._shut)

    def _shut(self) -> None:
        if hasattr(self, "_files"):
            self._files.close()

    def __enter__(self) -> Recorder:
        """Nothing to do: all is open from construction."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write the fields of the last step, and close.

        They are written after a StepError too, which all ranks raise alike; any other error may be
        one rank's own.
        Where the run has gone on since the last report that was written, its fields are gone.
        """
        together = error is None or isinstance(error, StepError)
        try:
            if together:
                self.complete()
            if error is None:
                self.close()
        finally:  # of this rank alone: others may not be here
            self._closed = True
            with suppress(OSError):  # the error that is under way tells more
                self._shut()

    def _check(self, report: Report) -> None:
        if self._closed:
            raise OutputError(f"Recorder.write: the recorder of '{self.folder}' is closed.")
        check_report("Recorder.write", self._scene, report)
        if self._before is not None and report.step <= self._before.step:
            raise SceneError(
                f"Recorder.write: step {report.step} comes after step {self._before.step}. Write "
                "each step once, and take a new recorder for another run."
            )

    def _due(self, report: Report) -> bool:
        if self._interval is None:
            return report.step % self._every == 0
        t = float(at_latest(report.t, min(report.dt, self._interval)))
        if t < self._next:
            return False
        self._next = (floor(t / self._interval) + 1) * self._interval
        return True

    def _write_fields(self, report: Report) -> None:
        points, cells = self._fields.on_nodes(report), self._fields.on_cells(report)
        clouds = {name: cloud.values(report) for name, cloud in self._clouds.items()}
        self._fields_at = report.step

        def write() -> None:
            for series in self._files.series("fields"):
                series.write(report.t, points, cells)
            for name, values in clouds.items():
                for series in self._files.series(name):
                    series.write(report.t, values, {})
            if self._fields.may_have_bodies(report):
                self._files.rows("bodies").add(body_rows(report))

        self._on_first_rank(write)

    def _on_first_rank(self, action: Callable[[], None]) -> None:
        """Write on rank 0, and raise its errors on all ranks. Collective."""
        on_rank_0(self._comm, action, self._problem)

    def _problem(self, error: Exception) -> str:
        if not isinstance(error, OSError):
            return f"Recorder: no folder can be called {str(self.folder)!a}: {error}."
        if isinstance(error, BlockingIOError):
            return (
                f"Recorder: another recorder writes to the folder '{self.folder}', in this process "
                "or in another. Close that one, wait for its run to end, or name another folder."
            )
        if isinstance(error, ChangedFile):
            return (
                f"Recorder: '{error.filename}' has changed since the checkpoint: {error.strerror}. "
                "Bring it back, name another folder, or begin anew with resume=False."
            )
        return (
            f"Recorder: cannot write to the folder '{self.folder}' "
            f"({error.strerror or error}: '{error.filename or self.history}'). Name a folder that "
            "you may write to and where no file is in the way, and check the space left there."
        )

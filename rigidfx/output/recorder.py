"""The files of a run: a row per step in history.csv, and fields for ParaView.

    folder/history.csv     one row per step, flushed at once, numbers in full precision
    folder/events.csv      one row per body that was frozen, changed or released; only if there may
                           be such events
    folder/bodies.csv      one row per body at each time of the fields; only if there may be bodies
    folder/fields.pvd      fields for ParaView, at the output interval
    folder/fields/         its files, one per time
    folder/view.py         a script for ParaView that shows them; see `view`

The fields are displacement [m] and velocity [m/s] on the nodes, and on the cells the Cauchy stress
(nine components) and von Mises' [Pa], both as `stress` defines them, the number of the material,
and, where there are rigid bodies or may be, the number of the body (0 outside bodies), a flag
(1 rigid, 0 flexible) and, where parts are found, the strain rate of the step [1/s], zero in bodies.

A run may end at any instant, by Ctrl-C or kill -9: each file is whole up to the last row or time
that was written.

Columns of history.csv, in SI units; a vector has one column for each of x, y, z:

    step, t, dt, iterations, linear_iterations, cuts, unknowns
    kinetic, strain, stored, springs, energy at t; stored in bodies, in springs, and the sum [J]
    work_of_loads, work_of_supports          in the step [J]
    dissipated                               by all damping in the step [J]
    impact_energy                            change of energy where a support began [J]
    momentum_scale, L_x …                    Σ m|v| and linear momentum [kg m/s]
    J_x …                                    angular momentum about the origin [kg m²/s]
    bodies, J_rigid_x …                      number of rigid bodies, and their part of it
    reaction_NAME_x …                        of each support [N], zero while it does not act
    u_NAME_x …                               displacement of each probe [m]
    wall                                     wall time of the step [s]

Columns of events.csv: t, kind, reason, unknowns_before, unknowns_after of the event; name, number,
cells_before, cells_after, stored_before, stored_after of the body [J]; energy_frozen,
energy_released, energy_lost [J], linear_momentum_error [kg m/s], angular_momentum_error [kg m²/s]
of the event.

Columns of bodies.csv: t, number, name, cells, mass [kg], centre_x … of mass [m], velocity_x … of it
[m/s], angular_velocity_x … [rad/s], rotation_x …, the rotation vector since the body became rigid
[rad], kinetic, stored [J].
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from math import floor
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from rigidfx.base.errors import OutputError, SceneError, StepError, agree
from rigidfx.base.inputs import positive
from rigidfx.effects import Rigid
from rigidfx.flexible.stress import CauchyStress, von_mises
from rigidfx.output.paraview import Body, Series
from rigidfx.output.paraview_script import write as write_view
from rigidfx.report.report import BodyReport, Report
from rigidfx.scene.scene import Scene

__all__ = ["Recorder", "read_history"]

Array = npt.NDArray[np.float64]

SCALARS = (
    *("step", "t", "dt", "iterations", "linear_iterations", "cuts", "unknowns"),
    *("kinetic", "strain", "stored", "springs", "energy", "work_of_loads", "work_of_supports"),
)


EVENT = (
    *("t", "kind", "reason", "unknowns_before", "unknowns_after"),
    *("energy_frozen", "energy_released", "energy_lost"),
    *("linear_momentum_error", "angular_momentum_error"),
)
CHANGE = ("name", "number", "cells_before", "cells_after", "stored_before", "stored_after")
BODY = ("centre", "velocity", "angular_velocity", "rotation")


class Recorder:
    """Writes the reports of a run into a folder; a context manager.

    Only rank 0 writes. Files of a former run under the same names are replaced.

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
    ) -> None:
        """Make the folder and open history.csv. Collective.

        Args:
            scene: The problem that is run.
            folder: Folder for the output; made if it does not exist.
            every: Number of steps from one output of the fields to the next, so that output is a
                small part of the run; history.csv has a row for each step in any case ...
            interval: ... or, if given, at the first step that ends at or after each multiple of
                this time [s]. The last state is written in any case.
            stress: Whether stresses are among the fields. If not, none is computed or compiled.

        Raises:
            OutputError: On every rank, if the folder cannot be written to.
            SceneError: If every or interval cannot be used.
        """
        if not isinstance(every, int) or every < 1:
            raise SceneError(f"Recorder: every must be a whole number ≥ 1, got {every!r}.")
        if interval is not None:
            positive("Recorder", "interval", interval)
        self.folder = Path(folder)
        self._comm = scene.comm
        self._every, self._interval = every, interval
        self._supports = tuple(dict.fromkeys(support.where for support, _ in scene.supports))
        self._first = self._comm.rank == 0
        self._body = Body(scene.space)
        self._materials = self._body.on_cells(_material_numbers(scene))
        self._stress = CauchyStress(scene) if stress else None
        self._may_be_rigid = bool(scene.named(Rigid))
        self._last: Report | None = None
        self._fields_at, self._next = -1, 0.0
        problem = None
        try:
            if self._first:
                self.folder.mkdir(parents=True, exist_ok=True)
                self.history.open("w").close()
                self.events.unlink(missing_ok=True)
                self.bodies.unlink(missing_ok=True)
                self._series = Series(self.series, self._body)
                write_view(self.folder)
        except OSError as error:
            problem = self._problem(error)
        agree(self._comm, problem, OutputError)
        path = self.history if self._first else os.devnull
        self._file = open(path, "w", newline="", encoding="utf-8")  # noqa: SIM115
        self._rows = csv.DictWriter(self._file, _columns(self._supports, scene.probes))
        self._rows.writeheader()

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
        """Path of the series for ParaView."""
        return self.folder / "fields.pvd"

    def write(self, report: Report) -> None:
        """Add a row, and the fields where their time has come. Collective.

        Args:
            report: A step of the run.

        Raises:
            OutputError: On every rank, if rank 0 cannot write.
        """
        self._last = report
        problem = None
        try:
            self._rows.writerow(self._row(report))
            self._file.flush()
            if self._first:
                self._write_events(report)
        except OSError as error:
            problem = self._problem(error)
        agree(self._comm, problem, OutputError)
        if self._due(report):
            self._write_fields(report)

    def close(self) -> None:
        """Close history.csv."""
        self._file.close()

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
        """
        try:
            together = error is None or isinstance(error, StepError)
            if together and self._last is not None and self._last.step != self._fields_at:
                self._write_fields(self._last)
        finally:
            self.close()

    def _due(self, report: Report) -> bool:
        if self._interval is None:
            return report.step % self._every == 0
        if report.t < self._next * (1 - 1e-9):
            return False
        self._next = (floor(report.t / self._interval * (1 + 1e-9)) + 1) * self._interval
        return True

    def _write_events(self, report: Report) -> None:
        if report.finds_bodies:
            rows = [
                {name: getattr(event, name) for name in EVENT}
                | {name: getattr(change, name) for name in CHANGE}
                for event in report.events
                for change in event.changes
            ]
            _append(self.events, [*EVENT, *CHANGE], rows)

    def _write_bodies(self, report: Report) -> None:
        if self._may_have_bodies(report):
            _append(self.bodies, _body_columns(), [_body_row(report.t, b) for b in report.bodies])

    def _may_have_bodies(self, report: Report) -> bool:
        return self._may_be_rigid or report.finds_bodies

    def _cell_fields(self, report: Report) -> dict[str, npt.NDArray[Any]]:
        """Fields on the cells, whole on rank 0. Collective."""
        fields: dict[str, npt.NDArray[Any]] = {"material": self._materials}
        if self._stress is not None:
            stress = self._body.on_cells(self._stress.measure(report.state.u))
            fields |= {"stress": stress, "von_mises": von_mises(stress)}
        if self._may_have_bodies(report):
            body = self._body.on_cells(report.state.body_numbers())
            fields |= {"body": body, "rigid": (body > 0).astype(np.uint8)}
        if report.strain_rate is not None:
            fields["strain_rate"] = self._body.on_cells(report.strain_rate)
        return fields

    def _write_fields(self, report: Report) -> None:
        state = report.state
        state.rebuild()
        cells = self._cell_fields(report)
        points = {f.name: self._body.on_nodes(f) for f in (state.u, state.v)}
        self._fields_at = report.step
        problem = None
        if self._first:
            try:
                self._series.write(report.t, points, cells)
                self._write_bodies(report)
            except OSError as error:
                problem = self._problem(error)
        agree(self._comm, problem, OutputError)

    def _row(self, report: Report) -> dict[str, float]:
        row = {name: getattr(report, name) for name in SCALARS}
        row["dissipated"] = sum(report.dissipated.values())
        row["impact_energy"] = report.impact.energy if report.impact else 0.0
        row["momentum_scale"] = report.momentum_scale
        row |= _components("L", report.linear_momentum)
        row |= _components("J", report.angular_momentum)
        row["bodies"] = len(report.bodies)
        row |= _components("J_rigid", sum((b.angular_momentum for b in report.bodies), np.zeros(3)))
        for name in self._supports:
            row |= _components(f"reaction_{name}", report.reactions.get(name, np.zeros(3)))
        for name, displacement in report.probes.items():
            row |= _components(f"u_{name}", displacement)
        return row | {"wall": report.wall}

    def _problem(self, error: OSError) -> str:
        return (
            f"Recorder: cannot write to the folder '{self.folder}' "
            f"({error.strerror or error}: '{error.filename or self.history}'). Name a folder that "
            "you may write to and where no file is in the way, and check the space left there."
        )


def read_history(path: str | Path) -> dict[str, Array]:
    """The columns of a history.csv by name, each of shape (steps,).

    Args:
        path: The file; it may be that of a run that goes on, or was killed.

    Raises:
        OSError: If it cannot be read.
    """
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader([line for line in file if line.endswith("\n")])
    values = np.array(rows, dtype=np.float64).reshape(len(rows), len(header))
    return dict(zip(header, values.T, strict=True))


def _append(path: Path, columns: list[str], rows: list[dict[str, Any]]) -> None:
    """Add rows to a table, and its header if it is new."""
    new = not path.exists()
    if not (new or rows):
        return
    with path.open("a", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, columns)
        if new:
            table.writeheader()
        table.writerows(rows)


def _body_columns() -> list[str]:
    vectors = [f"{vector}_{axis}" for vector in BODY for axis in "xyz"]
    return ["t", "number", "name", "cells", "mass", *vectors, "kinetic", "stored"]


def _body_row(t: float, body: BodyReport) -> dict[str, Any]:
    row: dict[str, Any] = {"t": t, "number": body.number, "name": body.name, "cells": body.cells}
    row |= {"mass": body.mass, "kinetic": body.kinetic, "stored": body.stored}
    rotation = Rotation.from_matrix(body.orientation).as_rotvec()
    for name, vector in zip(
        BODY, (body.centre, body.velocity, body.angular_velocity, rotation), strict=True
    ):
        row |= _components(name, vector)
    return row


def _components(name: str, vector: Iterable[float]) -> dict[str, float]:
    return {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}


def _columns(supports: Iterable[str], probes: Iterable[str]) -> list[str]:
    named = [*(f"reaction_{s}" for s in supports), *(f"u_{p}" for p in probes)]
    vectors = ["L", "J", "J_rigid", *named]
    names = [f"{vector}_{axis}" for vector in vectors for axis in "xyz"]
    return [*SCALARS, "dissipated", "impact_energy", "momentum_scale", "bodies", *names, "wall"]


def _material_numbers(scene: Scene) -> npt.NDArray[np.int32]:
    """For each owned cell, which of the scene's materials it has, counted from 0."""
    numbers = np.zeros(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    for k, (_, cells) in enumerate(scene.materials):
        numbers[cells] = k
    return numbers

"""Joints against time: angles, travels, forces, efforts of motors, springs and stops."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import OutputError, SceneError
from rigidfx.base.inputs import path_of, shown
from rigidfx.base.types import Array
from rigidfx.output.history import columns_of, joint_columns, resolved_columns
from rigidfx.plot.curves import curves, is_table, on_first_rank
from rigidfx.plot.panels import of_joints
from rigidfx.report.report import Report

__all__ = ["joints"]


def joints(
    history: str | Path | Mapping[str, Array] | Iterable[Report],
    path: str | Path,
    *,
    title: str = "",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> None:
    """Draw joints against time. Collective.

    Panels have angles, travels, torques and forces of motors, springs and stops, and the sizes of
    the forces on second sides, without vibration that Δt does not resolve. A curve is left out
    where it is below a hundredth of its panel.

    Example:
        >>> reports = list(simulate(machine, dt=1e-3, t_end=0.1))   # doctest: +SKIP
        >>> joints(reports, "joints.png")

    Args:
        history: A history.csv or its folder, its columns by name, or reports of a run.
        path: Picture to write.
        title: Heading.
        comm: Ranks that call this.

    Raises:
        OutputError: If there are no joints, the history cannot be read, or the picture cannot be
            drawn or written.
        SceneError: If an argument cannot be used.
    """
    path = path_of("joints", "path", path)
    given: Any = history
    of_reports: dict[str, Array] = {}
    if not isinstance(given, str | Path) and not is_table(given):
        steps = list(given) if isinstance(given, Iterable) else [given]
        if not all(isinstance(step, Report) for step in steps):
            raise SceneError(
                "joints: history must be a history.csv, its columns or a list of reports, got "
                f"{shown(history)}."
            )
        of_reports = joint_columns(steps)  # on all ranks, as reports find their joints

    def draw() -> None:
        if of_reports:
            h: Mapping[str, Array] = of_reports
        elif isinstance(history, str | Path):
            h = columns_of(history)
        else:
            h = {name: np.asarray(given[name]) for name in given}
        panels = of_joints({**h, **resolved_columns(h)})
        if not panels:
            raise OutputError("there are no joints, or no steps after t = 0")
        lines = {heading: curves for heading, (curves, _) in panels.items()}
        labels = [label for _, label in panels.values()]
        curves(lines, path, xlabel="time (s)", ylabel=labels, title=title, comm=MPI.COMM_SELF)

    on_first_rank(comm, draw, f"joints: '{path}'")

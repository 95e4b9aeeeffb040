"""Parts of `accuracy_vs_time.py`: structures, their runs, and a picture."""

from __future__ import annotations

import inspect
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from common import comm, machines, write_json
from matplotlib.ticker import LogLocator
from scipy.interpolate import CubicSpline

import rigidfx as rf
from rigidfx.plot import figure_of, on_first_rank, save
from rigidfx.plot.curves import DPI


@dataclass(frozen=True)
class Setting:
    """The choices of a run.

    Attributes:
        dt: Δt, or the longest one with a budget [s].
        budget: Of `Accuracy`, which chooses Δt and bodies; neither is chosen if 0.
        reduced: Whether the structure's parts are reduced.
    """

    dt: float
    budget: float = 0.0
    reduced: bool = False


@dataclass(frozen=True)
class Structure:
    """A structure, and its runs.

    Attributes:
        name: Its name.
        scene: Makes the problem, of parts that are reduced.
        at: The probe that is compared.
        of: Length that errors are parts of [m].
        t_end: End of its runs [s].
        quiet: Time up to which Δt is ten times as long [s].
        reference: The setting that errors are against.
        ways: Name of a curve → the settings along it, the fastest first.
        parts: The parts that may be reduced.
    """

    name: str
    scene: Callable[..., rf.Scene]
    at: str
    of: float
    t_end: float
    quiet: float
    reference: Setting
    ways: dict[str, list[Setting]]
    parts: tuple[rf.Reduced, ...] = ()


@dataclass(frozen=True)
class Run:
    """A run in numbers.

    Attributes:
        t: Ends of its steps [s].
        path: Places of the probe then, a list of three each [m].
        cpu_s: Time of the processor, set-up included [s].
        unknowns: At the start.
        saved: Unknowns that were saved, as a part of unknowns × time.
    """

    t: list[float]
    path: list[list[float]]
    cpu_s: float
    unknowns: int
    saved: float

    def error(self, reference: Run, of: float) -> float:
        """Largest distance of the probe from that of a reference, as a part of a length."""
        exact = CubicSpline(reference.t, reference.path)(self.t)
        return float(np.linalg.norm(self.path - exact, axis=1).max() / of)


def measured(structure: Structure, setting: Setting, folder: Path) -> Run:
    """A run, out of its file in a folder if there is one for the same scene and setting.

    Collective.
    """
    source = inspect.getsource(structure.scene) + inspect.getsource(machines)
    text = f"{source} {structure.t_end} {structure.parts} {setting} {comm.size}"
    path = folder / f"{structure.name} {sha256(text.encode()).hexdigest()[:12]}.json"
    found = None
    if comm.rank == 0 and path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))["run"]
    found = comm.bcast(found)
    if found is not None:
        return Run(**found)
    run = _carried_out(structure, setting)
    write_json(path, {"setting": asdict(setting), "run": asdict(run)}, indent=None)
    return run


def _carried_out(structure: Structure, setting: Setting) -> Run:
    parts, rule = structure.parts if setting.reduced else (), {}
    dt: float | dict[float, float] = setting.dt
    if setting.budget:
        rule["accuracy"] = rf.Accuracy(setting.budget, structure.at, of=structure.of)
    elif structure.quiet:
        dt = {0.0: 10 * setting.dt, structure.quiet: setting.dt}
    given = dt, structure.t_end
    next(rf.simulate(structure.scene(*parts), *given, **rule))  # compiles forms, which stay
    began = time.process_time()
    scene = structure.scene(*parts)
    reports = rf.simulate(scene, *given, **rule)
    first = next(reports)
    t, path, saved = [first.t], [_place(scene, first, structure.at)], 0.0
    for report in reports:
        t.append(report.t)
        path.append(_place(scene, report, structure.at))
        saved += report.dt * (1 - report.unknowns / first.unknowns)
    cpu = time.process_time() - began
    # All ranks take over the time of rank 0.
    return comm.bcast(Run(t, path, cpu, first.unknowns, saved / structure.t_end))


def _place(scene: rf.Scene, report: rf.Report, at: str) -> list[float]:
    return list(map(float, scene.probes[at] + report.probes[at]))


Row = Mapping[str, Any]
COLOURS = {
    "all flexible": "0.45",
    "asked for": "#0072b2",
    "parts reduced by name": "#009e73",
}


def draw(panels: Mapping[str, Sequence[Row]], path: Path) -> None:
    """Draw curves of rows with `way`, `cpu_s`, `error` and `asked`, by titles of panels.

    Collective.
    """

    def picture() -> None:
        title = "Error against computing time: down and to the left is better"
        figure, axes = figure_of(-(-len(panels) // 2), min(len(panels), 2), (9.2, 8.4), title)
        figure.set_dpi(DPI)
        for ax, (name, rows) in zip(axes.flat, panels.items(), strict=False):
            _panel(ax, name, rows)
        for ax in axes[:, 0]:
            ax.set_ylabel("error of the probe (%)")
        axes[0, 0].legend(frameon=False, loc="lower left")
        save(figure, path)

    on_first_rank(comm, picture, path.stem)


def _panel(ax: Any, name: str, rows: Sequence[Row]) -> None:
    ax.set(title=name, xlabel="time of one core (s)", xscale="log", yscale="log")
    for way, colour in COLOURS.items():
        if not (along := [row for row in rows if row["way"] == way]):
            continue
        x, y = ([row[key] for row in along] for key in ("cpu_s", "percent"))
        ax.plot(x, y, marker="o", color=colour, linewidth=2.5, label=way)
        for k, row in enumerate(row for row in along if row["asked"]):
            text, place = f"{100 * row['asked']:g} % asked", (row["cpu_s"], row["percent"])
            beside = 7, 8 - 12 * (k % 2)  # in turn above and below
            ax.annotate(text, place, beside, textcoords="offset points", color=colour)
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.minorticks_off()
    ax.margins(0.25)

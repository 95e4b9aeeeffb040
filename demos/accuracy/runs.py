"""A run in numbers, out of its file if there is one."""

from __future__ import annotations

import inspect
import json
import time
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
from common import comm, write_json
from scipy.interpolate import CubicSpline

import rigidfx as rf

from .structure import Setting, Structure


@dataclass(frozen=True)
class Run:
    """A run in numbers.

    Attributes:
        t: Ends of its steps [s].
        path: Places of the probe then, a list of three each [m].
        cpu_s: Time of the processor, set-up included [s].
        unknowns: At the start.
        rigid: Unknowns that were saved, as a part of unknowns × time.
    """

    t: list[float]
    path: list[list[float]]
    cpu_s: float
    unknowns: int
    rigid: float

    def error(self, reference: Run, of: float) -> float:
        """Largest distance of the probe from that of a reference, as a part of a length."""
        exact = CubicSpline(reference.t, reference.path)(self.t)
        return float(np.linalg.norm(self.path - exact, axis=1).max() / of)


def measured(structure: Structure, setting: Setting, folder: Path) -> Run:
    """A run, out of its file if there is one for the same scene and setting. Collective.

    Args:
        structure: What is run.
        setting: How.
        folder: Where finished runs are.

    Raises:
        OutputError: On every rank, if a file cannot be written.
    """
    source = inspect.getsource(structure.scene)
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
    if setting.tol:
        rule["rigidify"] = rf.StrainRate(
            setting.tol, setting.window, wake=setting.wake, min_cells=structure.min_cells
        )
    if setting.budget:
        rule["accuracy"] = rf.Accuracy(setting.budget, structure.at, of=structure.of)
    options = {"snes_rtol": setting.newton}
    given = setting.dt, structure.t_end
    next(rf.simulate(structure.scene(*parts), *given, **rule))  # compiles forms, which stay
    began = time.process_time()
    scene = structure.scene(*parts)
    reports = rf.simulate(scene, *given, petsc_options=options, **rule)
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

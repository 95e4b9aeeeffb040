"""A run, out of its file if there is one."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
from common import comm, write_json

import rigidfx as rf

from .plans import REFERENCE
from .setting import Setting, petsc_options
from .structure import Structure

COLUMNS = "t", "dt", "energy", "motion", "unknowns", "newton", "wall", "cpu", "x", "y", "z"
History = dict[str, list[float]]  # the columns, an entry per step


def run(structure: Structure, setting: Setting, folder: Path) -> History:
    """The history of a run, out of its file if there is one. Collective.

    Args:
        structure: What is run.
        setting: The knobs.
        folder: Where finished runs are, in files named by their settings.

    Raises:
        OutputError: On every rank, if a file is damaged or cannot be written.
    """
    path, what = _path(structure, setting, folder)
    found = _known(path, structure)
    if found is not None:
        return found
    history = _carried_out(structure, setting)
    content = {"settings": what, "fingerprint": structure.fingerprint, "history": history}
    write_json(path, content, indent=None)
    return history


def _carried_out(structure: Structure, setting: Setting) -> History:
    scene = structure.scene(structure.mesh(setting.refine), setting)
    least = structure.min_cells * setting.refine**3
    criterion = rf.StrainRate(setting.tol, setting.window, wake="all", min_cells=least)
    rule: dict[str, object] = {"rigidify": criterion if setting.tol else None}
    if setting.budget:
        rule = {"accuracy": rf.Accuracy(setting.budget, structure.at, of=structure.of)}
    rows = []
    with petsc_options(setting):
        reports = rf.simulate(scene, setting.dt, structure.t_end, progress=True, **rule)
        began = time.process_time()
        for report in reports:
            cpu, began = time.process_time() - began, time.process_time()
            x = {name: X + report.probes[name] for name, X in scene.probes.items()}
            motion, newton = structure.motion(x), report.iterations
            row = report.t, report.dt, report.energy, motion, report.unknowns, newton, report.wall
            rows.append((*row, cpu, *x[structure.at]))
    # All ranks take over the times of rank 0.
    return comm.bcast(dict(zip(COLUMNS, map(list, zip(*rows, strict=True)), strict=True)))


def known(structure: Structure, setting: Setting, folder: Path) -> bool:
    """Whether there is a run already. Collective."""
    return _known(_path(structure, setting, folder)[0], structure) is not None


def _path(structure: Structure, setting: Setting, folder: Path) -> tuple[Path, dict[str, object]]:
    """The file of a run, and what it is named by."""
    what: dict[str, object] = {"t_end": structure.t_end, **asdict(setting)}
    if setting.budget:
        what |= {"of": structure.of}
    else:
        del what["budget"]
    if setting != structure.settings[REFERENCE]:  # whose time does not matter
        what |= {"ranks": comm.size}
    if setting.tol:
        what |= {"min_cells": structure.min_cells}
    key = " ".join([structure.name, *(f"{name}={value}" for name, value in what.items())])
    return folder / f"{key}.json", what


def _known(path: Path, structure: Structure) -> History | None:
    """The history that a file holds; None if there is none, or of another structure. Collective."""
    found, problem = None, None
    if comm.rank == 0 and path.exists():
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["fingerprint"] == structure.fingerprint:
                found = content["history"]
                t, *others = np.array([found[name] for name in COLUMNS])
                if not np.isfinite(others).all() or abs(t[-1] - structure.t_end) > 1e-6:
                    raise ValueError("a run that does not go to its end")
        except (OSError, ValueError, KeyError, TypeError) as error:
            problem = f"accuracy_vs_time: '{path}' is damaged ({error!r}); delete it."
    found, problem = comm.bcast((found, problem))
    if problem is not None:
        raise rf.OutputError(problem)
    return found

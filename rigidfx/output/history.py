"""The table of a run's steps, history.csv: its rows, and how to read it.

docs/columns.md lists the columns.
"""

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import nan
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from rigidfx import effects as fx
from rigidfx.base.errors import OutputError
from rigidfx.base.inputs import path_of
from rigidfx.base.types import Array
from rigidfx.flexible.stress import SYMMETRIC
from rigidfx.report.peaks import Peak
from rigidfx.report.probe_stress import StressAt
from rigidfx.report.report import Report
from rigidfx.report.resolved_forces import resolved
from rigidfx.scene.scene import Scene

SCALARS = (
    *("step", "t", "dt", "iterations", "tangents", "linear_iterations", "cuts"),
    "unknowns",
    *("kinetic", "strain", "stored", "springs", "energy", "work_of_loads", "work_of_supports"),
)

# Columns of the ledger, and where it has their numbers.
LEDGER = {
    "frozen": "frozen.spent",
    "energy_allowed": "frozen.allowed",
    "damped": "damping.spent",
    "damping_allowed": "damping.allowed",
    "deformation": "frozen.scale",
    "time_error": "time.spent",
    "displacement": "time.scale",
    "time_allowed": "time.allowed",
    "rejected": "rejected",
    "rigidity_error": "rigidity.spent",
    "rigidity_allowed": "rigidity.allowed",
    "periods": "periods",
    "unsure": "unsure",
    "measured_error": "measured.spent",
}
FORCES = r"((reaction|moment)_.*|joint_.*_(force|moment))_[xyz]$|joint_.*_motor(_|$)"

PAIRS = {"xyz"[i] + "xyz"[j]: (i, j) for i, j in SYMMETRIC}


@dataclass(frozen=True)
class Written:
    """The last report that was written."""

    step: int  # its step
    t: float  # its time [s]
    velocities: Mapping[str, Array]  # of probes by name [m/s]


def history_row(
    scene: Scene,
    report: Report,
    stresses: Mapping[str, StressAt],
    peaks: Mapping[str, Peak],
    before: Written | None,
) -> dict[str, float]:
    """The row of a step, by the names of the columns, which are the same for all steps.

    Stresses at probes and peaks are there if they are among the columns.
    """
    bodies = report.bodies
    row = {name: getattr(report, name) for name in SCALARS}
    row["dissipated"] = sum(report.dissipated.values())
    row |= _step_of(report)
    row["momentum_scale"] = report.momentum_scale
    row |= {"bodies": len(bodies), "shapes": sum(body.shapes for body in bodies)}
    row["nu"] = max((body.nu for body in bodies), default=0.0)
    row |= components("L", report.linear_momentum)
    row |= components("J", report.angular_momentum)
    row |= components("impulse", report.impulse)
    row |= components("angular_impulse", report.angular_impulse)
    row |= components("J_rigid", sum((body.angular_momentum for body in bodies), np.zeros(3)))
    for name in dict.fromkeys(support.where for support, _ in scene.supports):
        row |= components(f"reaction_{name}", report.reactions.get(name, np.zeros(3)))
        row |= components(f"moment_{name}", report.reaction_moments.get(name, np.zeros(3)))
    for name, displacement in report.probes.items():
        row |= components(f"u_{name}", displacement)
        row |= components(f"v_{name}", report.velocities[name])
        row |= components(f"a_{name}", _acceleration(report, before, name))
    for name, at in stresses.items():
        row[f"von_mises_{name}"] = at.von_mises
        for of, tensor in (("stress", at.stress), ("strain", at.strain)):
            row |= {f"{of}_{name}_{pair}": float(tensor[ij]) for pair, ij in PAIRS.items()}
    for name, peak in peaks.items():
        row |= {f"peak_{name}": peak.von_mises, **components(f"peak_{name}", peak.place)}
    if contacts := scene.named(fx.Contact):
        row["contact"] = report.contact
    for contact in contacts:
        row |= _of_contact(report.touches.get(contact.title, fx.Touch(contact.title)))
    row |= _of_joints(fx.efforts_of(scene), report.joints)
    for spring in scene.named(fx.SpringDamper):
        own = report.spring_dampers.get(spring.title, fx.SpringDamperReport(nan, nan, nan))
        row |= {f"spring_{spring.title}_{name}": value for name, value in vars(own).items()}
    for name, of in LEDGER.items():
        row[name] = nan if report.ledger is None else float(attrgetter(of)(report.ledger))
    return row | {"wall": report.wall}


def _step_of(report: Report) -> dict[str, float]:
    """The columns that show where steps of one length and kind end, and their values."""
    energy = report.impact.energy if report.impact else 0.0
    named = {name: getattr(report, name) for name in ("step", "t", "dt", "unknowns")}
    return named | {"impact_energy": energy}


def _acceleration(report: Report, before: Written | None, probe: str) -> Array:
    """Mean acceleration of a probe since another report, shape (3,) [m/s²]."""
    if before is None or not report.t > before.t:
        return np.full(3, nan)
    change = report.velocities[probe] - before.velocities[probe]
    return np.asarray(change / (report.t - before.t))


def _of_joints(
    joints: Mapping[str, Sequence[str]], told: Mapping[str, fx.JointReport]
) -> dict[str, float]:
    """The columns of joints and their values, by their titles."""
    out: dict[str, float] = {}
    unknown = np.full(3, nan)
    for title, owners in joints.items():
        joint = told.get(title, fx.JointReport(unknown, lambda: (unknown, unknown, {}), gap=nan))
        for name in ("place", "force", "moment"):
            out |= components(f"joint_{title}_{name}", getattr(joint, name))
        for name in ("angle", "travel", "angle_rate", "travel_rate", "gap"):
            out[f"joint_{title}_{name}"] = getattr(joint, name)
        for owner in owners:
            kind = owner.replace(f" of '{title}'", "").replace(", ", "_").replace(" ", "_")
            column = f"joint_{title}_{kind.replace('JointSpring', 'Spring').lower()}"
            out[column] = joint.efforts.get(owner, 0.0 if title in told else nan)
    return out


def joint_columns(reports: Iterable[Report]) -> dict[str, Array]:
    """Steps and the columns of joints of some reports, as in history.csv."""
    steps = list(reports)
    joints: dict[str, list[str]] = {}
    for report in steps:
        for title, joint in report.joints.items():
            known = joints.setdefault(title, [])
            known += [owner for owner in joint.efforts if owner not in known]
    rows = [_step_of(report) | _of_joints(joints, report.joints) for report in steps]
    return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}


def _of_contact(touch: fx.Touch) -> dict[str, float]:
    """The columns of a contact and their values."""
    out = components(f"contact_{touch.name}_force", touch.force)
    out |= components(f"contact_{touch.name}_moment", touch.moment)
    for name in ("pressing", "resolved", "energy", "dissipated", "penetration", "nodes"):
        out[f"contact_{touch.name}_{name}"] = float(getattr(touch, name))
    return out


def components(name: str, vector: Iterable[float]) -> dict[str, float]:
    """The columns of a vector, shape (3,), and their values."""
    return {f"{name}_{axis}": float(x) for axis, x in zip("xyz", vector, strict=True)}


def read_history(path: str | Path) -> Any:
    """The columns of a history.csv by name: a pandas table, or arrays where there is no pandas.

    pandas is optional. `history["t"]` is a column in either case, of shape (steps,), and
    `list(history)` are their names; `np.asarray(history["t"])` is an array in either case.

    Forces of supports and joints, their moments and the efforts of motors have one more column
    each, such as `joint_pin_motor_resolved`, without vibration that Δt does not resolve, for peaks:
    see `rigidfx.report.resolved_forces`.

    Args:
        path: The file, or the folder of a `Recorder` with it; its run may go on, or was killed.

    Raises:
        OutputError: If it is not there, is no table of numbers, or cannot be read.
        SceneError: If path is none.
    """
    found = columns_of(path)
    found |= {f"{name}_resolved": values for name, values in resolved_columns(found).items()}
    try:
        import pandas
    except ImportError:
        return found
    return pandas.DataFrame(found)


def resolved_columns(h: Mapping[str, Array]) -> dict[str, Array]:
    """Forces of supports and joints and efforts of motors without unresolved vibration, by name."""
    names = [name for name in h if re.match(FORCES, name)]
    if not names or not {"step", "dt", "unknowns", "impact_energy"} <= set(h):
        return {}
    cut = (np.diff(h["step"], prepend=0) != 1) | (np.diff(h["unknowns"], prepend=0) != 0)
    forces = np.stack([h[name] for name in names], axis=1)
    return dict(
        zip(names, resolved(forces, h["dt"], cut | (h["impact_energy"] != 0)).T, strict=True)
    )


def columns_of(path: str | Path) -> dict[str, Array]:
    """The columns of a history.csv as arrays: see `read_history`."""
    path = path_of("read_history", "path", path)
    if path.is_dir():
        path = path / "history.csv"
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.reader([line for line in file if line.endswith("\n")]))
    except FileNotFoundError:
        raise OutputError(f"read_history: there is no file '{path}'.") from None
    except (OSError, UnicodeError, csv.Error) as error:
        raise OutputError(f"read_history: '{path}' cannot be read: {error}.") from error
    if not lines:
        raise OutputError(f"read_history: '{path}' has no whole line: no run has written to it.")
    header, *rows = lines
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise OutputError(f"read_history: '{path}' has the column '{twice[0]}' twice.")
    try:
        values = np.array(rows, dtype=np.float64).reshape(len(rows), len(header))
    except ValueError:
        number, problem = _first_bad(rows, len(header))
        raise OutputError(f"read_history: '{path}', row {number}: {problem}.") from None
    return dict(zip(header, values.T, strict=True))


def _first_bad(rows: list[list[str]], width: int) -> tuple[int, str]:
    """The number of the first row, from 1, that is not so many numbers, and what it is."""
    for k, row in enumerate(rows, start=1):
        if len(row) != width:
            return k, f"{len(row)} numbers in {width} columns"
        for text in row:
            try:
                float(text)
            except ValueError:
                return k, f"{text!r} is no number"
    return 0, "rows cannot be read as numbers"

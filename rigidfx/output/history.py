"""The table of a run's steps, history.csv: its columns and rows, and how to read it.

Columns, in SI units; a vector has one column for each of x, y, z:

    step, t, dt, iterations, linear_iterations, cuts, unknowns
    kinetic, strain, stored, springs, energy at t; stored in bodies, in springs, and the sum [J]
    work_of_loads, work_of_supports          in the step [J]
    dissipated                               by all damping in the step [J]
    impact_energy                            change of energy where a support began [J]
    momentum_scale, L_x …                    Σ m|v| and linear momentum [kg m/s]
    J_x …                                    angular momentum about the origin [kg m²/s]
    impulse_x …                              by supports besides their reactions: where they or
                                             bodies begin or end, and on velocities that alternate
                                             [N s]
    angular_impulse_x …                      its moment about the origin [N m s]
    bodies, shapes, nu, J_rigid_x …          number of bodies and of their shapes, the largest ν of
                                             them (`BodyReport`), their part of J
    reaction_NAME_x …                        of each support [N], zero while it does not act
    moment_NAME_x …                          its moment about the origin [N m], likewise
    u_NAME_x …                               displacement of each probe [m]
    v_NAME_x …                               velocity of each probe [m/s]
    a_NAME_x …                               its change since the last row over the time since then
                                             [m/s²]: the mean acceleration; NaN in the first row
    von_mises_NAME, stress_NAME_xx …         stress at each probe [Pa], and
    strain_NAME_xx …                         strain there: xx, yy, zz, xy, yz, xz; extrapolated and
                                             averaged, see `rigidfx.flexible.nodal_stress`
    peak_NAME, peak_NAME_x …                 largest von Mises stress over each set of `peaks` [Pa],
                                             and its node's place in the reference shape [m]
    contact                                  stored in contacts at t [J]; in scenes with contacts
    joint_NAME_place_x, _force_x, _moment_x … place of the joint NAME at t [m]; force on its second
                                             side and moment about the place [N, N m]
    joint_NAME_angle, _angle_rate            of a joint that turns [rad, rad/s]; else NaN
    joint_NAME_travel, _travel_rate, _gap    of one that slides [m, m/s]; violation at t [m]
    joint_NAME_motor, _spring, _stop         effort of each motor, spring and stop of the joint in
                                             the step [N m, N], zero while it does not act; of two
                                             motors _motor_torque_1, _motor_speed, …
    contact_NAME_force_x …, _moment_x …      of each contact [N, N m], zero while it does not act
    contact_NAME_pressing, _resolved         sum of the sizes of its nodal forces [N]; its mean over
                                             the shortest time that the mesh resolves, for peaks
    contact_NAME_energy, _dissipated         stored at t, taken by friction in the step [J]
    contact_NAME_penetration, _nodes         greatest [m], number of nodes that touch, at t
    frozen, energy_allowed                   what the ledger says: kept of vibrations, and what that
                                             may be [J]
    damped, damping_allowed                  taken by numerical damping, and what that may be [J]
    deformation                              what these are relative to [J]
    time_error, displacement, time_allowed   estimated error of time integration, what it is
                                             relative to, and what it may be [m]; NaN where
                                             nothing estimates it, or nothing was asked
    rejected                                 steps so far that erred by too much in time
    rigidity_error, rigidity_allowed         the same of what is rigid [m], with an `Accuracy`
    periods                                  that the motion has gone through so far
    unsure                                   0 where these are estimates, 1 where rigidity_error is
                                             unknown, and 2 where time_error is, too: from the first
                                             contact on
    measured_error                           largest distance from a twin so far [m], likewise
    wall                                     wall time of the step [s]
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from rigidfx.base.errors import OutputError
from rigidfx.base.inputs import path_of
from rigidfx.base.types import Array
from rigidfx.effects import JointReport, SpringDamperReport, Touch
from rigidfx.flexible.stress import SYMMETRIC
from rigidfx.report.peaks import Peak
from rigidfx.report.probe_stress import StressAt
from rigidfx.report.report import Report
from rigidfx.report.resolved_forces import resolved

SCALARS = (
    *("step", "t", "dt", "iterations", "tangents", "linear_iterations", "cuts"),
    "unknowns",
    *("kinetic", "strain", "stored", "springs", "energy", "work_of_loads", "work_of_supports"),
)

LEDGER = (
    *("frozen", "energy_allowed", "damped", "damping_allowed", "deformation"),
    *("time_error", "displacement", "time_allowed", "rejected"),
    *("rigidity_error", "rigidity_allowed", "periods", "unsure", "measured_error"),
)
UNSURE = "estimate", "unknown"
NO_JOINTS: Mapping[str, Sequence[str]] = {}
FORCES = r"((reaction|moment)_.*|joint_.*_(force|moment))_[xyz]$|joint_.*_motor(_|$)"


PAIRS = {"xyz"[i] + "xyz"[j]: (i, j) for i, j in SYMMETRIC}


@dataclass(frozen=True)
class Written:
    """The last report that was written.

    Attributes:
        step: Its step.
        t: Its time [s].
        velocities: Of probes by name [m/s].
    """

    step: int
    t: float
    velocities: Mapping[str, Array]


def history_columns(
    supports: Iterable[str],
    probes: Sequence[str],
    contacts: Sequence[str] = (),
    stress: bool = False,
    joints: Mapping[str, Sequence[str]] = NO_JOINTS,
    springs: Sequence[str] = (),
    peaks: Sequence[str] = (),
) -> list[str]:
    """Names of the columns.

    Args:
        supports: Names of the sets that supports hold.
        probes: Names of the probes.
        contacts: Titles of the contacts.
        stress: Whether stress and strain at the probes are among them.
        joints: Titles of each joint's motors, springs and stops, by the title of the joint.
        springs: Titles of the springs between two points.
        peaks: Names of the sets whose largest stress is among them.
    """
    stresses = [name for probe in probes if stress for name in _stress_names(probe)]
    named = [
        *(f"{of}_{support}" for support in supports for of in ("reaction", "moment")),
        *(f"{of}_{probe}" for probe in probes for of in "uva"),
    ]
    vectors = ["L", "J", "impulse", "angular_impulse", "J_rigid", *named]
    names = [f"{vector}_{axis}" for vector in vectors for axis in "xyz"]
    first = [*SCALARS, "dissipated", "impact_energy", "momentum_scale", "bodies", "shapes", "nu"]
    of_contacts = [*(["contact"] if contacts else []), *_of_contacts(contacts, {})]
    of_joints = [*_of_joints(joints, {}), *_of_springs(springs, {})]
    stresses += [f"peak_{name}{at}" for name in peaks for at in ("", "_x", "_y", "_z")]
    return [*first, *names, *stresses, *of_contacts, *of_joints, *LEDGER, "wall"]


def history_row(
    report: Report,
    supports: Sequence[str],
    contacts: Sequence[str] = (),
    stresses: Mapping[str, StressAt] | None = None,
    joints: Mapping[str, Sequence[str]] = NO_JOINTS,
    springs: Sequence[str] = (),
    peaks: Mapping[str, Peak] | None = None,
    before: Written | None = None,
) -> dict[str, float]:
    """The row of a step, by the names of the columns.

    Args:
        report: The step.
        supports: Names of the sets that supports hold, now or at another time.
        contacts: Titles of the contacts, likewise.
        stresses: Stress and strain at the probes, if they are among the columns.
        joints: Titles of each joint's motors, springs and stops, by the title of the joint.
        springs: Titles of the springs between two points.
        peaks: Largest stresses, if they are among the columns.
        before: The report of the row before, None in the first one.
    """
    row = {name: getattr(report, name) for name in SCALARS} | _step_of(report)
    row["dissipated"] = sum(report.dissipated.values())
    row["momentum_scale"] = report.momentum_scale
    row |= components("L", report.linear_momentum)
    row |= components("J", report.angular_momentum)
    row |= components("impulse", report.impulse)
    row |= components("angular_impulse", report.angular_impulse)
    row["bodies"] = len(report.bodies)
    row["shapes"] = sum(body.shapes for body in report.bodies)
    row["nu"] = max((body.nu for body in report.bodies), default=0.0)
    row |= components("J_rigid", sum((b.angular_momentum for b in report.bodies), np.zeros(3)))
    for name in supports:
        row |= components(f"reaction_{name}", report.reactions.get(name, np.zeros(3)))
        row |= components(f"moment_{name}", report.reaction_moments.get(name, np.zeros(3)))
    for name, displacement in report.probes.items():
        row |= components(f"u_{name}", displacement)
        row |= components(f"v_{name}", report.velocities[name])
        row |= components(f"a_{name}", _acceleration(report, before, name))
    for name, at in (stresses or {}).items():
        own = [at.stress[ij] for ij in PAIRS.values()], [at.strain[ij] for ij in PAIRS.values()]
        values = [at.von_mises, *own[0], *own[1]]
        row |= dict(zip(_stress_names(name), map(float, values), strict=True))
    for name, peak in (peaks or {}).items():
        row |= {f"peak_{name}": peak.von_mises, **components(f"peak_{name}", peak.place)}
    if contacts:
        row["contact"] = report.contact
        row |= _of_contacts(contacts, report.touches)
    row |= _of_joints(joints, report.joints) | _of_springs(springs, report.spring_dampers)
    return row | _spent(report) | {"wall": report.wall}


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
    joints: Mapping[str, Sequence[str]], told: Mapping[str, JointReport]
) -> dict[str, float]:
    """The columns of joints and their values, by their titles."""
    out: dict[str, float] = {}
    unknown = np.full(3, nan)
    for title, owners in joints.items():
        joint = told.get(title, JointReport(unknown, unknown, unknown, gap=nan))
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


def _of_springs(springs: Sequence[str], told: Mapping[str, SpringDamperReport]) -> dict[str, float]:
    """The columns of springs between two points and their values, by their titles."""
    known = {title: told.get(title, SpringDamperReport(nan, nan, nan)) for title in springs}
    names = [field.name for field in fields(SpringDamperReport)]
    return {f"spring_{t}_{name}": getattr(own, name) for t, own in known.items() for name in names}


def _spent(report: Report) -> dict[str, float]:
    """Values of the ledger, by the names of the columns."""
    ledger = report.ledger
    if ledger is None:
        return dict.fromkeys(LEDGER, nan)
    frozen, damping = ledger.frozen, ledger.damping
    of_energy = frozen.spent, frozen.allowed, damping.spent, damping.allowed
    time = ledger.time
    of_time = frozen.scale, time.spent, time.scale, time.allowed, float(ledger.rejected)
    of_rigidity = ledger.rigidity.spent, ledger.rigidity.allowed, ledger.periods
    unsure = float(len(UNSURE) if ledger.struck else UNSURE.index(ledger.sure))
    every = *of_energy, *of_time, *of_rigidity, unsure, ledger.measured.spent
    return dict(zip(LEDGER, every, strict=True))


def _stress_names(probe: str) -> list[str]:
    tensors = [f"{what}_{probe}_{pair}" for what in ("stress", "strain") for pair in PAIRS]
    return [f"von_mises_{probe}", *tensors]


def _of_contacts(contacts: Sequence[str], touches: Mapping[str, Touch]) -> dict[str, float]:
    """The columns of contacts and their values, by their titles."""
    out: dict[str, float] = {}
    for title in contacts:
        touch = touches.get(title, Touch(title))
        out |= components(f"contact_{title}_force", touch.force)
        out |= components(f"contact_{title}_moment", touch.moment)
        for name in ("pressing", "resolved", "energy", "dissipated", "penetration", "nodes"):
            out[f"contact_{title}_{name}"] = float(getattr(touch, name))
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

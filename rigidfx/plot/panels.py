"""Panels of curves from the columns of a history: probes, supports, joints and their elements."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from rigidfx.base.errors import OutputError, SceneError
from rigidfx.base.inputs import path_of, shown
from rigidfx.base.types import Array
from rigidfx.output.history import columns_of, joint_columns, resolved_columns
from rigidfx.plot.curves import Curve, curves, is_table, on_first_rank, prefixed
from rigidfx.report.report import Report

Panels = dict[str, tuple[list[Curve], str]]  # heading → curves, and title of the ordinate

SEEN = 0.01  # of the largest value in a panel: what is never as large is left out
MOST = 18  # curves in a panel; more cannot be told from each other
PROBES = {
    "Displacements of probes": (r"u_(.+)_([xyz])$", "displacement", "m"),
    "Von Mises stress at probes, from nodes": (r"von_mises_(.+)$", "stress", "Pa"),
    "Reactions": (r"reaction_(.+)_([xyz])$", "force on the structure", "N"),
}


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


def of_probes(h: Mapping[str, Array]) -> Panels:
    """Panels of probes and supports, by the columns of a history.csv."""
    out: Panels = {}
    for heading, (pattern, what, unit) in PROBES.items():
        found = {" ".join(m.groups()): h[name] for name in h if (m := re.match(pattern, name))}
        _add(out, heading, h["t"], found, what, unit)
    return out


def of_joints(h: Mapping[str, Array]) -> Panels:
    """Panels of joints: angles, travels, sizes of forces, efforts of motors, springs and stops.

    The effort of a joint that both turns and slides may be a torque or a force: such are apart.
    """
    out: Panels = {}
    titles = [m[1] for name in h if (m := re.match(r"joint_(.+)_gap$", name))]
    for kind, unit in (("angle", "rad"), ("travel", "m")):
        found = {title: h[f"joint_{title}_{kind}"] for title in titles}
        _add(out, f"{kind.capitalize()}s of joints", h["t"], found, kind, unit, unit == "m")
    efforts: dict[str, dict[str, Array]] = {}
    for name, values in h.items():
        of = max((t for t in titles if name.startswith(f"joint_{t}_")), key=len, default=None)
        own = "" if of is None else name.removeprefix(f"joint_{of}_")
        if re.match(r"(motor|spring|stop)(_|$)", own):
            unit = _unit_of(h, f"joint_{of}", own)
            efforts.setdefault(unit, {})[f"{own.replace('_', ' ')} of {of}"] = values
    for unit, found in sorted(efforts.items()):
        heading = {"N m": "Torques", "N": "Forces"}.get(unit, "Torques or forces")
        words = "efforts" if " or " in unit else heading.lower().removesuffix("s")
        heading += " of motors, springs and stops"
        _add(
            out,
            heading,
            h["t"],
            dict(sorted(found.items())),
            words,
            unit,
            scaled=" or " not in unit,
        )
    forces = {
        title: np.linalg.norm([h[f"joint_{title}_force_{axis}"] for axis in "xyz"], axis=0)
        for title in titles
    }
    _add(out, "Forces of joints", h["t"], forces, "size of the force", "N")
    return out


def _unit_of(h: Mapping[str, Array], joint: str, own: str) -> str:
    """The unit of an effort; where the joint turns and slides, its name may tell."""
    turns, slides = (np.isfinite(h[f"{joint}_{kind}"]).any() for kind in ("angle", "travel"))
    if turns and slides:
        by = re.search("torque|angle|speed|(force|travel|rate)", own)
        return "N m or N" if by is None else "N" if by[1] else "N m"
    return "N" if slides else "N m"


def _add(
    out: Panels,
    heading: str,
    t: Array,
    found: Mapping[str, Array],
    what: str,
    unit: str,
    scaled: bool = True,
) -> None:
    """Add a panel of the curves that are not small beside the largest, if there are some."""
    known = {label: values for label, values in found.items() if np.isfinite(values).any()}
    if not known:
        return
    sizes = {label: float(np.nanmax(np.abs(values))) for label, values in known.items()}
    largest = max(sizes.values())
    factor, unit = prefixed(unit, largest) if scaled else (1.0, unit)
    least = SEEN * largest if scaled else 0.0
    seen = [label for label, size in sizes.items() if size >= least]
    if len(seen) > MOST:
        heading += f", the largest {MOST} of {len(seen)}"
        seen = sorted(seen, key=lambda label: -sizes[label])[:MOST]
    out[heading] = [Curve(label, t, factor * known[label]) for label in seen], f"{what} ({unit})"

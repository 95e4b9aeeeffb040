"""CalculiX (`ccx`): total Lagrangian, its direct solver; Newmark without damping, and statics."""

import os
import re
import shutil
import subprocess
from pathlib import Path
from time import perf_counter, sleep

import numpy as np
from common import ROOT

from .case import Array, Case, Outcome

UNPACKED = ROOT / "out" / "peers" / "ccx"  # as the docstring of peers.py says
LIBRARIES = ("usr/lib", "usr/lib/x86_64-linux-gnu", "usr/lib/aarch64-linux-gnu")
ELEMENT = {8: "C3D8", 10: "C3D10"}  # by nodes of a cell; full integration
TOLERANCE = 1e-6  # of Newton's residual, relative to the mean force (5e-3 by default)


def calculix_there(named: str | None = None) -> str | None:
    """Path of `ccx`: the one named, the system's or the unpacked one, with its libraries."""
    unpacked = UNPACKED / "usr/bin/ccx"
    found = named or shutil.which("ccx") or (str(unpacked) if unpacked.exists() else None)
    if found:
        root = Path(found).resolve().parents[2]
        paths = [str(root / part) for part in LIBRARIES] + [os.environ.get("LD_LIBRARY_PATH", "")]
        os.environ["LD_LIBRARY_PATH"] = ":".join(filter(None, paths))
    return found


def deck(case: Case, static: str | None = None) -> str:
    """Its input, of numbers of at most 20 characters; load steps of a kind of cells, or motion."""
    material, n = case.material, case.cells.shape[1]
    times = np.append(case.factor.times, case.dt * (case.steps + 1))
    values = np.append(case.factor.values, 0.0)
    loads = [
        f"{node + 1}, {axis + 1}, {case.forces[node, axis]:.12g}"
        for node, axis in zip(*np.nonzero(case.forces), strict=True)
    ]
    cells = [", ".join(map(str, row)) for row in case.cells + 1]
    lines = [
        "*NODE, NSET=ALL",
        *(f"{k}, {x:.12g}, {y:.12g}, {z:.12g}" for k, (x, y, z) in enumerate(case.nodes, 1)),
        f"*ELEMENT, TYPE={static or ELEMENT[n]}, ELSET=CELLS",
        *(f"{k}, {row}" for k, row in enumerate(cells, 1)),
        "*NSET, NSET=PROBE",
        str(case.probe + 1),
        "*MATERIAL, NAME=M",
        "*ELASTIC",
        f"{material.E}, {material.nu}",
        "*DENSITY",
        str(material.rho),
        "*SOLID SECTION, ELSET=CELLS, MATERIAL=M",
        "*AMPLITUDE, NAME=A",
        *(f"{t:.12g}, {value:.12g}" for t, value in zip(times, values, strict=True)),
    ]
    if case.held_nodes.size:
        lines += ["*NSET, NSET=HELD", *(str(k + 1) for k in case.held_nodes)]
        lines += ["*BOUNDARY", "HELD, 1, 3"]
    lines += [
        "*STEP, NLGEOM, INC=1000000",
        "*STATIC, DIRECT" if static else "*DYNAMIC, DIRECT, ALPHA=0.",
        f"{case.dt:.12g}, {case.dt * case.steps:.12g}",
        "*CONTROLS, PARAMETERS=FIELD",
        f"{TOLERANCE}, 1.",
        "*CLOAD, AMPLITUDE=A",
        *loads,
        "*NODE PRINT, NSET=PROBE",
        "U",
    ]
    lines += [] if static else ["*EL PRINT, ELSET=CELLS, TOTALS=ONLY", "ELSE, ELKE"]
    lines += ["*END STEP"]
    return "\n".join(lines) + "\n"


def started(case: Case, command: str, folder: Path, text: str) -> subprocess.Popen[bytes]:
    """Its process, which reads the text."""
    folder.mkdir(parents=True, exist_ok=True)
    name = file_name(case)
    for old in folder.glob(f"{name}.*"):
        old.unlink()
    (folder / f"{name}.inp").write_text(text)
    with open(folder / f"{name}.log", "w") as log:
        return subprocess.Popen(
            [command, "-i", name],
            cwd=folder,
            env={**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"},
            stdout=log,
            stderr=subprocess.STDOUT,
        )


def file_name(case: Case) -> str:
    """Of its files, without the ending."""
    return case.name.replace(" ", "_")


def calculix(case: Case, command: str, folder: Path) -> Outcome:
    """Run a case by the program `ccx`, with files in a folder."""
    name, outcome = file_name(case), Outcome(solver="spooles")
    process = started(case, command, folder, deck(case))
    outcome.seconds = seconds_between_steps(process, folder / f"{name}.sta")
    if process.returncode:
        outcome.failed = f"ccx ended with {process.returncode}"
    read_steps(folder / f"{name}.sta", outcome)
    read_energies(folder / f"{name}.dat", case, outcome)
    if len(outcome.times) < case.steps:
        outcome.failed = outcome.failed or f"it ended after {len(outcome.times)} steps"
    return outcome


def calculix_static(case: Case, command: str, folder: Path, element: str) -> Array:
    """Displacement of the probe after load steps of a factor from zero to one, shape (3,) [m].

    Cells are of a kind such as "C3D8"; a `RuntimeError` tells that CalculiX fails.
    """
    if started(case, command, folder, deck(case, element)).wait():
        raise RuntimeError(f"CalculiX fails: see {folder / file_name(case)}.log")
    return last_move((folder / f"{file_name(case)}.dat").read_text())


def seconds_between_steps(process: subprocess.Popen[bytes], status: Path) -> list[float]:
    """Wall times between the lines of its list of steps [s], but the first, until it ends."""
    seen: list[float] = []
    while True:
        running = process.poll() is None
        lines = status.read_text().splitlines()[2:] if status.exists() else []
        seen += [perf_counter()] * (len(lines) - len(seen))
        if not running:
            return [float(x) for x in np.diff(seen)]
        sleep(0.0005)


def read_steps(status: Path, outcome: Outcome) -> None:
    """Times and iterations of steps from its list of them: step, increment, attempt, …"""
    for line in status.read_text().splitlines()[2:] if status.exists() else []:
        _, _, _, iterations, total, *_ = line.split()
        outcome.times.append(float(total))
        outcome.newton.append(int(iterations))


def read_energies(printed: Path, case: Case, outcome: Outcome) -> None:
    """Energies after each step and the last place of the probe from what it prints."""
    text = printed.read_text() if printed.exists() else ""
    totals = {
        kind: [float(x) for x in re.findall(rf"total {kind} energy.*?\n\s*\n?\s*([-+.\dE]+)", text)]
        for kind in ("internal", "kinetic")
    }
    outcome.energies = [sum(both) for both in zip(*totals.values(), strict=False)]
    outcome.times = outcome.times[: len(outcome.energies)]
    if "displacements" in text:
        outcome.probe = case.nodes[case.probe] + last_move(text)


def last_move(text: str) -> Array:
    """The last displacement that it prints of the probe [m]."""
    *_, move = re.finditer(r"displacements.*?\n\s*\n\s*\d+\s+(\S+)\s+(\S+)\s+(\S+)", text)
    return np.array([float(x) for x in move.groups()])

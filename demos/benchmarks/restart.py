"""Runs that are killed at random instants by kill -9, and go on from their checkpoints.

* *contact*: a bar that is pulled and strikes a wall.
* *joints*: two bars in a hinge with a spring, which swing and are struck.
* *1, 3, 2 ranks*: the first bar, killed on one rank, on three and on two in turn.
* *overhead*: what checkpoints take of a run of 20 000 unknowns, with one each minute.

In all of them bodies freeze, and forces release them. A run that was killed goes on until it is
over, and then another one begins, until there were as many kills as are asked for. What it has
written is compared with a run that was not killed and leaves checkpoints at the same steps: the
columns of history.csv but the wall time, Newton's counts and gaps of joints, relative to the
largest value of their kind, events.csv and fields.pvd. From history.csv the balance of energy is
closed, relative to the largest energy.

Starts of processes take most of the time. Runs on one rank that are not to be killed have none of
their own.

    ./fenicsx python3 demos/benchmarks/restart.py
"""

import csv
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from bench import DT, MATERIAL, PUSH, Parser, bar, cells_of_bar, conclude, without_mpi
from bench.waking_scenes import STIFF, stalk_and_block
from bench.waking_scenes import scene as stalk_scene
from common import boxes, comm
from mpi4py import MPI

import rigidfx as rf

CASES = {  # scene, ranks in turn
    "contact, 1 rank": ("contact", (1,)),
    "contact, 2 ranks": ("contact", (2,)),
    "joints, 1 rank": ("joints", (1,)),
    "joints, 2 ranks": ("joints", (2,)),
    "1, 3, 2 ranks": ("contact", (1, 3, 2)),
}
POLITE = {  # processes let others work
    "OMP_NUM_THREADS": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "MPIR_CVAR_ENABLE_HEAVY_YIELD": "1",
    "MPIR_CVAR_POLLS_BEFORE_YIELD": "1",
}
KILLS = 50
ENERGIES = "kinetic", "strain", "stored", "springs", "dissipated"  # relative to the largest energy
APART = "wall", "iterations", "tangents", "linear_iterations"  # of the machine, of Newton's method
LONGEST = 3.0  # s from when a run moves to when it is killed; a short run's time if that is less
WAIT = 300.0  # s, after which a run counts as hanging
MINUTE = 60.0  # s
EVERY = 25  # steps from one checkpoint to the next


def bouncing() -> tuple[rf.Scene, dict[str, Any]]:
    """A bar that is pulled, rests, and strikes a wall beside it: bodies freeze and are released."""
    pulls = rf.Table([0, 1, 1.2, 1.6, 1.8, 4.4, 4.6, 5, 5.2], [0.0, 0, 60, 60, 0, 0, 60, 60, 0])
    wall = rf.Contact("z1", against=rf.Plane((0, 0, 1.004), (0, 0, -1)), stiffness=1e6)
    pull = rf.Traction("x1", (0, 0, 1.0), time=pulls)
    effects = rf.Fixed("x0"), pull, wall, rf.MassDamping(4.0)
    scene = stalk_scene(stalk_and_block((16, 1, 1)), *effects)
    return scene, {"dt": 0.02, "t_end": 8.0, "rigidify": rf.StrainRate(1e-4, 0.3)}


def linked() -> tuple[rf.Scene, dict[str, Any]]:
    """Two bars with a spring in the hinge between them; they swing and are struck twice."""
    sizes = ((0, 0, 0), (1, 0.2, 0.2)), ((1.02, 0, 0), (2.02, 0.2, 0.2))
    box = boxes(*((*ends, (5, 1, 1)) for ends in sizes))
    for name, side in (("left", 1), ("right", -1)):
        box = box.with_cells(name, lambda x, s=side: s * x[0] < s * 1.01)
        box = box.with_facets(
            f"{name} end", lambda x, s=side: (s * x[0] < s * 1.01) & (abs(x[0] - 1.01) < 0.22)
        )
    box = box.with_facets("tip", lambda x: x[0] > 2.02 - 1e-9)
    box = box.with_vertices("axis", lambda x: (abs(x[0]) < 1e-9) & (abs(x[2]) < 1e-9))
    sides = rf.MeanFace("left end"), rf.MeanFace("right end")
    pin = rf.Revolute(*sides, (1.01, 0.1, 0.1), (0, 1, 0), name="pin")
    spring = rf.JointSpring("pin", stiffness=2.0, damping=0.05)
    blows = rf.Table([0, 0.8, 0.82, 0.84, 1.6, 1.62, 1.64], [0.0, 0, 1, 0, 0, 1, 0])
    push = rf.Traction("tip", (0, 0, 1e3), time=blows)
    damping = rf.StiffnessDamping(ratio=0.2, frequency=60.0)
    effects = [rf.Fixed("axis"), rf.Gravity((0, 0, -9.81)), pin, spring, push, damping]
    scene = rf.Scene(box, STIFF, effects, probes={"tip": (2.02, 0.1, 0.1)})
    return scene, {"dt": 0.004, "t_end": 2.4, "rigidify": rf.StrainRate(1e-3, 0.1)}


SCENES: dict[str, Callable[[], tuple[rf.Scene, dict[str, Any]]]] = {
    "contact": bouncing,
    "joints": linked,
}


def go_on(case: str, folder: Path, part: float) -> None:
    """Begin a run, or go on with it, until it is over.

    A file tells that it moves, and at the end another one how long it did so [s].
    """
    scene, call = SCENES[case]()
    again = any(folder.glob("checkpoint-*.rfx"))
    if again:
        steps = rf.resume(folder, scene)
    else:
        call["t_end"] *= part
        steps = rf.simulate(scene, checkpoint=rf.Checkpoint(folder, steps=EVERY), **call)
    began = 0.0
    with rf.Recorder(scene, folder, every=100, stress=False) as recorder:
        for report in steps:
            recorder.write(report)
            began = began or time.perf_counter()
            if report.step % EVERY == 1:
                (folder / f"moves-{os.getpid()}").touch()
    if comm.rank == 0:
        (folder / "over").write_text(str(time.perf_counter() - began), encoding="utf-8")


def started(case: str, folder: Path, ranks: int, part: float) -> subprocess.Popen[bytes]:
    """A process that runs a case in a folder."""
    command = [sys.executable, __file__, "--go-on", case, str(folder), str(part)]
    extra = ["--oversubscribe"] if "Open MPI" in MPI.Get_library_version() else []
    if ranks > 1:
        command = ["mpirun", *extra, "-n", str(ranks), *command]
    kept = POLITE | without_mpi()
    log = (folder / "told").open("ab")
    return subprocess.Popen(command, env=kept, stdout=log, stderr=log, start_new_session=True)


def killed(process: subprocess.Popen[bytes], folder: Path, after: float) -> bool:
    """Kill all ranks of a process after a time from when they move; False if it was over before."""
    end = time.monotonic() + WAIT
    while process.poll() is None and not any(folder.glob("moves-*")):
        assert time.monotonic() < end, f"a run hangs: {(folder / 'told').read_text()[-2000:]}"
        time.sleep(0.01)
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        ranks = [int(path.name.partition("-")[2]) for path in folder.glob("moves-*")]
        for number in ranks:
            os.kill(number, signal.SIGKILL)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    assert process.returncode == 0, (folder / "told").read_text()[-3000:]
    return False


def run(case: str, folder: Path, ranks: int, part: float, after: float | None = None) -> bool:
    """Go on with a case on some ranks, to its end unless it is killed before; whether it was."""
    if after is None and ranks == 1:
        go_on(case, folder, part)
        return False
    for left in folder.glob("moves-*"):
        left.unlink()
    return killed(started(case, folder, ranks, part), folder, WAIT if after is None else after)


def compared(folder: Path, reference: Path) -> float:
    """Largest difference of two runs, over the largest value of its kind; inf if rows differ."""
    ours, theirs = (rf.read_history(path / "history.csv") for path in (folder, reference))
    if len(ours["t"]) != len(theirs["t"]):
        return np.inf
    every = [name for name in theirs if name not in APART and not name.endswith("_gap")]
    off, size = (dict.fromkeys([kind_of(name) for name in every], 0.0) for _ in range(2))
    for name in every:
        a, b = (np.nan_to_num(np.asarray(rows[name], dtype=float)) for rows in (ours, theirs))
        kind = kind_of(name)
        if kind.startswith("a_"):  # a difference of velocities over Δt, and compared with these
            dt = np.asarray(theirs["dt"], dtype=float)
            a, b, kind = a * dt, b * dt, kind.replace("a_", "v_", 1)
        off[kind] = max(off[kind], float(np.abs(a - b).max()))
        size[kind] = max(size[kind], float(np.abs(b).max()))
    size["nu"] = 1.0  # a share of energies
    worst = max(off[kind] / max(size[kind], 1e-300) for kind in off)
    for name in ("fields.pvd", "events.csv"):
        if not same_rows(folder / name, reference / name):
            return np.inf
    return worst


def kind_of(column: str) -> str:
    """The columns whose largest value a column is compared with."""
    return "energy" if column in ENERGIES else re.sub("_[xyz](_resolved)?$", "", column)


def same_rows(one: Path, other: Path) -> bool:
    """Whether files have the same rows: times, kinds, reasons and numbers of cells."""
    if one.exists() != other.exists():
        return False
    if not one.exists():
        return True
    if one.suffix != ".csv":
        return one.read_bytes() == other.read_bytes()
    names = "t", "kind", "reason", "name", "cells_before", "cells_after"
    both = []
    for path in (one, other):
        with path.open(newline="", encoding="utf-8") as file:
            both.append([[row[name] for name in names] for row in csv.DictReader(file)])
    return both[0] == both[1]


def switches(folder: Path) -> int:
    """How many instants there are in events.csv at which bodies were frozen or released."""
    with (folder / "events.csv").open(newline="", encoding="utf-8") as file:
        return len({(row["t"], row["kind"]) for row in csv.DictReader(file)})


def balance(folder: Path) -> float:
    """Energy that history.csv does not account for, relative to the largest."""
    rows = {k: np.asarray(v, float) for k, v in rf.read_history(folder / "history.csv").items()}
    came = rows["work_of_loads"] + rows["work_of_supports"] + rows["impact_energy"]
    off = rows["energy"] - rows["energy"][0] - np.cumsum(came - rows["dissipated"])
    return float(np.abs(off).max() / rows["energy"].max())


def case_of(name: str, kills: int, part: float, seed: int) -> dict[str, Any]:
    """A row of the summary: kill a case so many times."""
    case, ranks = CASES[name]
    draw, worst, unbalanced, count, runs = random.Random(seed), 0.0, 0.0, 0, 0
    with tempfile.TemporaryDirectory() as place:
        reference = Path(place) / "reference"
        reference.mkdir()
        run(case, reference, ranks[0], part)
        longest = min(LONGEST, float((reference / "over").read_text(encoding="utf-8")))
        while count < kills:
            folder = Path(place) / f"run {runs}"
            folder.mkdir()
            while not (folder / "over").exists():
                after = longest * draw.random() if count < kills else None
                was_killed = run(case, folder, ranks[count % len(ranks)], part, after)
                count += was_killed
            worst, runs = max(worst, compared(folder, reference)), runs + 1
            unbalanced = max(unbalanced, balance(folder))
            shutil.rmtree(folder)
        events = switches(reference)
    row = {"case": name, "ranks_before": list(ranks), "ranks_after": list(ranks[1:] + ranks[:1])}
    found = {"kills": count, "runs": runs, "switches": events, "energy_unbalanced": unbalanced}
    return {**row, **found, "largest_difference": worst, "overhead": None}


def overhead(unknowns: int, turns: int) -> dict[str, Any]:
    """A row of the summary: what a checkpoint takes, as a part of a minute."""
    domain = bar(*cells_of_bar(unknowns))
    scene = rf.Scene(domain, MATERIAL, [rf.Fixed("x0"), PUSH], element="enhanced")
    with tempfile.TemporaryDirectory() as place:
        taken = []
        for every in (1, 10**6) * turns:
            left = rf.Checkpoint(place, steps=every)
            steps = rf.simulate(scene, DT, 100.0, checkpoint=left)
            for _ in range(4):
                next(steps)
            began = time.perf_counter()
            for _ in range(6):
                next(steps)
            taken.append((time.perf_counter() - began) / 6)
            steps.close()
        size = max(path.stat().st_size for path in Path(place).glob("*.rfx"))
    cost = max(median(taken[::2]) - median(taken[1::2]), 0.0)
    row = {"case": "overhead", "ranks_before": [1], "ranks_after": [1], "kills": 0}
    more = {"checkpoint_s": cost, "step_s": median(taken[1::2]), "megabytes": size / 1e6}
    return {**row, "largest_difference": None, "overhead": cost / MINUTE, **more}


def main() -> None:
    """Kill all cases, measure, and write the summary."""
    if len(sys.argv) > 1 and sys.argv[1] == "--go-on":
        go_on(sys.argv[2], Path(sys.argv[3]), float(sys.argv[4]))
        return
    parser = Parser(__file__, __doc__.splitlines()[0], short="one kill of one case, a short run")
    parser.add_only("cases")
    parser.add_argument("--kills", type=int, default=KILLS, help="of each case")
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    parser.add_argument("--part", type=float, default=1.0, help="of the runs' lengths")
    options = parser.read(kills=1, only="contact, 1", part=0.2)
    names = [name for name in CASES if options.only in name]
    rows = [case_of(name, options.kills, options.part, options.seed) for name in names]
    if options.only in "overhead" or options.short:
        rows.append(overhead(600 if options.short else 20_000, 1 if options.short else 5))
    conclude(options.out, rows)
    for row in rows:
        if row["largest_difference"] is not None:  # growth makes rounding larger
            assert row["largest_difference"] <= 1e-9, row["case"]
        assert options.short or row["overhead"] is None or row["overhead"] <= 0.02


if __name__ == "__main__":
    main()

"""Three levels by size: flexible, found by the run, and reduced by name.

Scenes stand in `bench/reduced_cases.py`; each runs whole, set-up included, on one core:

- flexible: the twin, in which all cells are flexible;
- default: what a user gets who names nothing, `StrainRate(Relative(0.01), "auto")`;
- reduced: parts named `Reduced`.

Δt is the same in all three. An entry of summary.json is a level of a scene at a size:

- case, level, unknowns (most of the twin), left (fewest of the run);
- seconds of the processor for the whole run, set-up included, and for `set_up` alone;
- ratio: seconds over those of the twin;
- memory: the most that the process has taken [MB];
- energy: largest error of its balance over the largest energy;
- errors against the twin, of what the scene is about.

`growth` tells the exponent of seconds by unknowns for each scene and level; `tumbling` has drifts.

    ./fenicsx python3 demos/benchmarks/reduced.py
    ./fenicsx python3 demos/benchmarks/reduced.py --only drop --levels flexible reduced
    ./fenicsx python3 demos/benchmarks/reduced.py --only plate --levels reduced --most 2000000
    ./fenicsx python3 demos/benchmarks/reduced.py --only plate --most 150000 --resume

Each run is a process of its own, so that memory is that of one run. Sizes up to 150 000 unknowns
take some hours of one core; with --resume a run that has been measured into the folder before is
not run again, and those of other scenes and sizes are in the table as well. A million unknowns have
no twin here: their run tells seconds and memory.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from bench import Parser, chosen, conclude, without_mpi
from bench.reduced_cases import SHORT, SIZES, Case, run, tumbling
from common import positive, say

import rigidfx as rf

LEVELS = "flexible", "default", "reduced"
TWINS_UP_TO = 150_000  # unknowns; a twin of a million takes a day
ENTRY, SEEN = "entry.json", "seen.npy"  # in the folder of a run


def carried_out(case: Case, level: str, folder: Path) -> None:
    """Run a level of a case, in a process of its own, and keep what it leaves."""
    found = rf.StrainRate(rf.Relative(0.01), "auto") if level == "default" else None
    own = run(case, case.parts if level == "reduced" else (), rigidify=found)
    left, most = own.unknowns
    entry = {"level": level, "unknowns": most, "left": left, "set_up": own.set_up}
    entry |= {"seconds": own.seconds, "energy": own.balance}
    np.save(folder / SEEN, own.seen)
    (folder / ENTRY).write_text(json.dumps(entry), encoding="utf-8")


def measured(name: str, unknowns: int, level: str, short: bool, folder: Path) -> None:
    """Have a process run a level of a scene, and note its memory."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ENTRY).unlink(missing_ok=True)
    command = [sys.executable, __file__, "--out", str(folder), "--run", name, str(unknowns), level]
    command += ["--short"] if short else []
    with subprocess.Popen(command, env=without_mpi(), stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    entry = json.loads((folder / ENTRY).read_text(encoding="utf-8"))
    entry = {"case": name, **entry, "memory": usage.ru_maxrss // 1024}
    (folder / ENTRY).write_text(json.dumps(entry), encoding="utf-8")


def rows(name: str, unknowns: int, case: Case, out: Path) -> list[dict[str, object]]:
    """The levels of a scene that have been run, each beside the twin where there is one."""
    found = {level: out / f"{name}_{unknowns}_{level}" for level in LEVELS}
    found = {level: folder for level, folder in found.items() if (folder / ENTRY).exists()}
    entries = {
        level: json.loads((folder / ENTRY).read_text(encoding="utf-8"))
        for level, folder in found.items()
    }
    twin = entries.get("flexible")
    for level, entry in entries.items():
        if twin is not None and level != "flexible":
            entry["ratio"] = entry["seconds"] / twin["seconds"]
            seen, exact = (np.load(found[of] / SEEN) for of in (level, "flexible"))
            entry["errors"] = case.errors(seen, exact)
            entry["unknowns"] = twin["unknowns"]
        elif twin is None:
            entry["unknowns"] = unknowns
    return [*entries.values()]


def growth(table: list[dict[str, object]]) -> dict[str, float]:
    """Scene and level → exponent of seconds by unknowns, where there are three sizes."""
    found: dict[str, list[tuple[float, float]]] = {}
    for row in table:
        place = float(str(row["unknowns"])), float(str(row["seconds"]))
        found.setdefault(f"{row['case']}, {row['level']}", []).append(place)
    fits = {of: np.polyfit(*np.log(at).T, 1)[0] for of, at in found.items() if len(at) > 2}
    return {of: float(slope) for of, slope in fits.items()}


def main() -> None:
    """Run the scenes and write their table."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="coarse meshes")
    parser.add_only("scenes")
    parser.add_argument("--levels", nargs="+", default=[*LEVELS], choices=LEVELS, help="these")
    parser.add_argument("--least", type=positive, default=1, help="unknowns, at least")
    parser.add_argument("--most", type=positive, default=30_000, help="unknowns, at most")
    parser.add_argument("--resume", action="store_true", help="keep what has been measured")
    parser.add_argument("--run", nargs=3, metavar="X", help="a scene's size and level, alone")
    options = parser.read()
    sizes = SHORT if options.short else SIZES
    if options.run is not None:
        name, unknowns, level = options.run
        carried_out(sizes[name][int(unknowns)](), level, options.out)
        return
    asked, table = chosen(options, [*sizes, "tumbling"]), []
    for name, made in sizes.items():
        for unknowns, make in made.items():
            wanted = name in asked and options.least <= unknowns <= options.most
            for level in options.levels if wanted else ():
                folder = options.out / f"{name}_{unknowns}_{level}"
                done = options.resume and (folder / ENTRY).exists()
                if not done and (level == "reduced" or unknowns <= TWINS_UP_TO):
                    measured(name, unknowns, level, options.short, folder)
            if wanted or options.resume:
                table += (found := rows(name, unknowns, make(), options.out))
                say("\n".join(map(str, found)))
    found = {"rows": table, "growth": growth(table)}
    if "tumbling" in asked:
        found["tumbling"] = tumbling(500 if options.short else 10_000)
    conclude(options.out, found)
    assert all(row["energy"] < 1e-9 for row in table)
    assert "tumbling" not in found or found["tumbling"]["energy"] < 1e-9


if __name__ == "__main__":
    main()

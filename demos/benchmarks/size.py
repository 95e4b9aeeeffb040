"""What rigid parts pay by size: four demos at four sizes each, beside their flexible twins.

An entry of summary.json is a demo at a size:

- scene, unknowns;
- rigid_share: unknowns that rigid parts save, as a part of unknowns × time;
- error: of the quantity that the demo compares (`error_of` names it), over the twin's largest;
- time_ratio: time of all steps over that of the twin's;
- memory: the most that the process has taken [MB].

    ./fenicsx python3 demos/benchmarks/size.py
    ./fenicsx python3 demos/benchmarks/size.py --only drop --most 20000
    ./fenicsx python3 demos/benchmarks/size.py --only gong --least 20000 --resume

Each run is a process of its own, so that memory is that of one run. All take some hours of one
core; with --resume a run that has been measured into the folder before is not run again, and those
of other demos and sizes are in the table as well.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench import Parser, chosen, conclude, without_mpi
from common import ROOT, positive

ENTRY = "entry.json"  # of the table, in the folder of a run


@dataclass(frozen=True)
class Demo:
    """A demo, and how it is made larger.

    Attributes:
        arguments: Without a size.
        option: The one of the size.
        sizes: Unknowns, those that supports hold included → value of the option.
        compared: Key of the summary that holds the error.
    """

    arguments: Sequence[str]
    option: str
    sizes: dict[int, str]
    compared: str


DEMOS = {
    "drop_test": Demo(
        ["--compare"],
        "--size",
        {2736: "0.02", 25_320: "0.0033", 66_744: "0.0028", 91_872: "0.0022"},
        "peak_force_errors",
    ),
    "robot_arm": Demo(
        [],
        "--size",
        {10_503: "0.016", 20_997: "0.009", 46_557: "0.006", 102_636: "0.0044"},
        "swing_deviation",
    ),
    "gong": Demo(
        ["--compare"],
        "--across",
        {1734: "16", 6534: "32", 25_350: "64", 99_846: "128"},
        "error_of_way",
    ),
    "mechanism": Demo(
        ["--compare", "--turns", "1"],
        "--size",
        {12_945: "0.03", 38_574: "0.0125", 56_280: "0.0105", 109_899: "0.0078"},
        "error_of_way",
    ),
}


def saved(folder: Path) -> tuple[int, float]:
    """Unknowns of a run's first step, and the part of unknowns × time that is saved."""
    with (folder / "history.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    unknowns, dt = (np.array([float(row[name]) for row in rows[1:]]) for name in ("unknowns", "dt"))
    return int(unknowns.max()), float(1 - unknowns @ dt / (unknowns.max() * dt.sum()))


def known(name: str, value: str, out: Path) -> dict[str, object] | None:
    """The entry that a run has left; None if there is none."""
    entry = out / f"{name}_{value}" / ENTRY
    return json.loads(entry.read_text(encoding="utf-8")) if entry.exists() else None


def measured(name: str, value: str, short: bool, out: Path) -> dict[str, object]:
    """Run a demo at a size, and read and keep what it leaves."""
    demo, folder = DEMOS[name], out / f"{name}_{value}"
    command = [sys.executable, str(ROOT / "demos" / f"{name}.py"), "--out", str(folder)]
    command += [*demo.arguments, *(["--short"] if short else [demo.option, value])]
    with subprocess.Popen(command, env=without_mpi(), stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    unknowns, share = saved(folder)
    ratio = summary.get("time_ratio")
    if ratio is None:
        ratio = summary["wall_adaptive_s"] / summary["wall_flexible_s"]
    entry = {
        "scene": name,
        "unknowns": unknowns,
        "rigid_share": share,
        "error_of": demo.compared,
        "error": float(np.max(summary[demo.compared])),
        "time_ratio": ratio,
        "memory": usage.ru_maxrss // 1024,
    }
    (folder / ENTRY).write_text(json.dumps(entry), encoding="utf-8")
    return entry


def main() -> None:
    """Run the demos and write their table."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="the gong, in its short form")
    parser.add_only("demos")
    parser.add_argument("--least", type=positive, default=1, help="unknowns, at least")
    parser.add_argument("--most", type=positive, default=np.inf, help="unknowns, at most")
    parser.add_argument("--resume", action="store_true", help="keep what has been measured")
    options = parser.read()
    asked, table = chosen(options, DEMOS, ("gong",)), []
    for name, demo in DEMOS.items():
        for unknowns, value in list(demo.sizes.items())[: 1 if options.short else None]:
            entry = known(name, value, options.out) if options.resume else None
            if entry is None and name in asked and options.least <= unknowns <= options.most:
                entry = measured(name, value, options.short, options.out)
                print(entry, flush=True)
            if entry is not None:
                table.append(entry)
    conclude(options.out, table)
    assert all(entry["error"] <= 0.2 and entry["rigid_share"] > 0.2 for entry in table)


if __name__ == "__main__":
    main()

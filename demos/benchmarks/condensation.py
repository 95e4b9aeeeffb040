"""What a step with rigid parts costs: against the ideal, and against the fully flexible step.

A bar is pushed sideways at its end. Most of it is one rigid body; the *ideal* is a run of the
flexible cells alone with their cut face held: no condensation can be cheaper than leaving the rest
of the structure out. All three runs take their steps in turn, so that a change of the machine's
speed hits them alike; the first two take ten for one of the flexible run, which costs as much. Each
uses the solver that rigidfx chooses for it.

    ./fenicsx python3 demos/benchmarks/condensation.py --unknowns 27000 --rigid 0.9

`ratio_to_ideal` compares per Newton iteration, `ratio_to_flexible` per step; `--rigid 1` has six
unknowns left and no ideal.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rigidfx

MATERIAL = rigidfx.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)  # Pa, 1, kg/m³
DT = 0.1  # s
EDGE = 1.0  # m, of a cell
PUSH = (0.0, 2.0, 3.0)  # Pa on the end face
PAIRS = 10  # steps of the condensed and the ideal run for one of the flexible run


def shape(unknowns: int) -> tuple[int, int]:
    """Cells along and across a bar ten times as long as thick with about so many unknowns."""
    across = max(1, round((unknowns / 30) ** (1 / 3)))
    return max(2, round(unknowns / (3 * (across + 1) ** 2)) - 1), across


def bar(along: int, across: int) -> rigidfx.Domain:
    """The whole bar."""
    size = (along * EDGE, across * EDGE, across * EDGE)
    return rigidfx.box((0, 0, 0), size, (along, across, across))


def scenes(along: int, across: int, rigid: int) -> dict[str, rigidfx.Scene]:
    """The condensed, the fully flexible and the ideal problem."""
    push = rigidfx.Traction("x1", PUSH)
    whole = bar(along, across)
    stiff = whole.with_cells("stiff", lambda x: x[0] <= rigid * EDGE + 1e-9)
    out = {
        "condensed": rigidfx.Scene(stiff, MATERIAL, [push, rigidfx.Rigid("stiff")]),
        "flexible": rigidfx.Scene(whole, MATERIAL, [push]),
    }
    if rigid < along:
        rest = bar(along - rigid, across)
        out["ideal"] = rigidfx.Scene(rest, MATERIAL, [push, rigidfx.Fixed("x0")])
    return out


def timed(reports: Iterator[rigidfx.Report]) -> tuple[float, rigidfx.Report]:
    """Wall time of the next step [s] and its report."""
    start = perf_counter()
    report = next(reports)
    return perf_counter() - start, report


def main() -> None:
    """Run the comparison and write its summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unknowns", type=int, default=27_000, help="of the flexible bar")
    parser.add_argument("--rigid", type=float, default=0.9, help="part of the cells, 0 … 1")
    parser.add_argument("--steps", type=int, default=9, help="timed steps of the flexible bar")
    parser.add_argument("--out", type=Path, default=Path("out/condensation"))
    parser.add_argument("--short", action="store_true", help="1700 unknowns, few steps")
    arguments = parser.parse_args()
    if arguments.short:
        arguments.unknowns, arguments.steps = 1700, 3
    along, across = shape(arguments.unknowns)
    rigid = min(round(arguments.rigid * along), along)
    runs = {
        name: rigidfx.simulate(scene, DT, 1e6, progress=False)
        for name, scene in scenes(along, across, rigid).items()
    }
    for reports in runs.values():
        for _ in range(3):  # the initial state and two steps to warm up
            next(reports)
    rows: list[dict[str, tuple[float, rigidfx.Report]]] = []
    for _ in range(arguments.steps):
        flexible = timed(runs["flexible"])
        for _ in range(PAIRS):
            cheap = {name: timed(reports) for name, reports in runs.items() if name != "flexible"}
            rows.append({**cheap, "flexible": flexible})
    last = {name: report for name, (_, report) in rows[-1].items()}
    seconds = {name: median(row[name][0] for row in rows) for name in runs}
    newton = {name: float(np.mean([row[name][1].iterations for row in rows])) for name in runs}

    def per_iteration(row: dict[str, tuple[float, rigidfx.Report]], name: str) -> float:
        return row[name][0] / row[name][1].iterations

    summary = {
        "ratio_to_ideal": median(
            per_iteration(row, "condensed") / per_iteration(row, "ideal") for row in rows
        )
        if "ideal" in runs
        else None,
        "ratio_to_flexible": median(row["condensed"][0] / row["flexible"][0] for row in rows),
        "newton_per_step": newton,
        "unknowns": last["flexible"].unknowns,
        "unknowns_reduced": last["condensed"].unknowns,
        "rigid_cells": rigid / along,
        "seconds_per_step": seconds,
        "linear_iterations": {name: report.linear_iterations for name, report in last.items()},
        "solvers": {name: report.solver for name, report in last.items()},
    }
    for reports in runs.values():
        reports.close()
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    # Condensing must not cost Newton iterations, or it is not exact.
    assert newton["condensed"] <= newton["flexible"] + 1


if __name__ == "__main__":
    main()

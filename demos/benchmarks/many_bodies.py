"""What many rigid bodies cost: a chain of them against the same bar all flexible.

A bar is divided into segments of equal length. Each is one rigid body but for its last two layers
of cells, so that more bodies leave more cells flexible. What a Newton iteration then costs beyond
its flexible cells is told by `ratio_to_cells`: the ratio of times to that of numbers of flexible
cells; 1 would be bodies for nothing. All runs take their steps in turn.

    ./fenicsx python3 demos/benchmarks/many_bodies.py
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from statistics import median
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rigidfx

MATERIAL = rigidfx.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)  # Pa, 1, kg/m³
DT = 0.1  # s
ACROSS = 2  # cells
FLEXIBLE = 2  # layers of cells between bodies
PUSH = rigidfx.Traction("x1", (0.0, 0.02, 0.03))  # Pa


def chain(along: int, bodies: int) -> rigidfx.Scene:
    """A bar of so many cells, divided among so many bodies; flexible if none."""
    size = (along, ACROSS, ACROSS)
    bar, rigid = rigidfx.box((0, 0, 0), size, size), []
    for k in range(bodies):
        first, last = k * along / bodies, (k + 1) * along / bodies - FLEXIBLE
        bar = bar.with_cells(
            f"body {k + 1}",
            lambda x, first=first, last=last: (x[0] >= first - 1e-9) & (x[0] <= last + 1e-9),
        )
        rigid.append(rigidfx.Rigid(f"body {k + 1}"))
    return rigidfx.Scene(bar, MATERIAL, [PUSH, *rigid])


def main() -> None:
    """Run the comparison and write its summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", type=int, nargs="+", default=[1, 2, 5, 10, 20, 40])
    parser.add_argument("--along", type=int, default=160, help="cells along the bar")
    parser.add_argument("--steps", type=int, default=20, help="timed steps")
    parser.add_argument("--out", type=Path, default=Path("out/many_bodies"))
    parser.add_argument("--short", action="store_true", help="two chains, few steps")
    arguments = parser.parse_args()
    if arguments.short:
        arguments.bodies, arguments.along, arguments.steps = [1, 5], 40, 3
    runs = {
        bodies: rigidfx.simulate(chain(arguments.along, bodies), DT, 1e6, progress=False)
        for bodies in (0, *arguments.bodies)
    }
    for reports in runs.values():
        for _ in range(3):  # the initial state and two steps to warm up
            next(reports)
    times: dict[int, list[float]] = {bodies: [] for bodies in runs}
    newton: dict[int, list[int]] = {bodies: [] for bodies in runs}
    last: dict[int, rigidfx.Report] = {}
    for _ in range(arguments.steps):
        for bodies, reports in runs.items():
            start = perf_counter()
            report = next(reports)
            times[bodies].append((perf_counter() - start) / report.iterations)
            newton[bodies].append(report.iterations)
            last[bodies] = report
    for reports in runs.values():
        reports.close()

    def row(bodies: int) -> dict[str, float | int]:
        ratio = median(a / b for a, b in zip(times[bodies], times[0], strict=True))
        rigid = sum(body.cells for body in last[bodies].bodies)
        share = 1 - rigid / (arguments.along * ACROSS**2)
        return {
            "bodies": bodies,
            "flexible_cells": share,
            "unknowns": last[bodies].unknowns,
            "seconds_per_iteration": median(times[bodies]),
            "ratio_to_flexible": ratio,
            "ratio_to_cells": ratio / share,
            "newton_per_step": sum(newton[bodies]) / arguments.steps,
        }

    summary = {"chains": [row(bodies) for bodies in runs]}
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    # Condensing must not cost Newton iterations, or it is not exact.
    flexible, *chains = (each["newton_per_step"] for each in summary["chains"])
    assert max(chains) <= flexible + 1


if __name__ == "__main__":
    main()

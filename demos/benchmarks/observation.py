"""What it costs to look for rigid parts: a step that is observed against one that is not.

A bar is pushed sideways at its end. Two runs of it take their steps in turn; the one observes the
strain rate of every cell, records its signals and decides at the end of each window, but nothing
ever qualifies. A third run freezes and releases nine tenths of the bar a few times: what a switch
costs is told in steps.

    ./fenicsx python3 demos/benchmarks/observation.py --unknowns 27000
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
WINDOW = 5  # steps


def scene(unknowns: int) -> rigidfx.Scene:
    """A bar ten times as long as thick with about so many unknowns."""
    across = max(1, round((unknowns / 30) ** (1 / 3)))
    along = max(2, round(unknowns / (3 * (across + 1) ** 2)) - 1)
    bar = rigidfx.box((0, 0, 0), (along, across, across), (along, across, across))
    bar = bar.with_cells("end", lambda x: x[0] >= 0.9 * along - 1e-9)
    return rigidfx.Scene(bar, MATERIAL, [rigidfx.Traction("x1", (0.0, 2.0, 3.0))])


def main() -> None:
    """Run the comparison and write its summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=20, help="timed steps")
    parser.add_argument("--out", type=Path, default=Path("out/observation"))
    parser.add_argument("--short", action="store_true", help="1700 unknowns, few steps")
    arguments = parser.parse_args()
    if arguments.short:
        arguments.unknowns, arguments.steps = 1700, 10
    problem = scene(arguments.unknowns)
    end = DT * (arguments.steps + 2)
    nothing = rigidfx.StrainRate(0.0, WINDOW * DT)
    runs = {
        "plain": rigidfx.simulate(problem, DT, end, progress=False),
        "observed": rigidfx.simulate(problem, DT, end, rigidify=nothing, progress=False),
    }
    for reports in runs.values():
        for _ in range(3):  # the initial state and two steps to warm up
            next(reports)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    unknowns = 0
    for _ in range(arguments.steps):
        for name, reports in runs.items():
            start = perf_counter()
            unknowns = next(reports).unknowns
            seconds[name].append(perf_counter() - start)
    for reports in runs.values():
        reports.close()

    everything = rigidfx.StrainRate(
        1e9,
        WINDOW * DT,
        never="end",
        release=rigidfx.Release(at=[(2 * k + 2) * WINDOW * DT for k in range(3)]),
    )
    switches = []
    for report in rigidfx.simulate(
        problem, DT, 6.5 * WINDOW * DT, rigidify=everything, progress=False
    ):
        usual = median(seconds["plain"])
        if report.events:
            before = usual if report.events[0].kind == "freeze" else 0.0
            switches.append((report.events[0].kind, report.wall - before))
    summary = {
        "observed_to_plain": median(
            b / a for a, b in zip(seconds["plain"], seconds["observed"], strict=True)
        ),
        "seconds_per_step": {name: median(times) for name, times in seconds.items()},
        "freeze_in_steps": median(t for kind, t in switches if kind == "freeze")
        / median(seconds["plain"]),
        "release_in_steps": median(t for kind, t in switches if kind == "release")
        / median(seconds["plain"]),
        "unknowns": unknowns,
    }
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    assert len(switches) >= 4


if __name__ == "__main__":
    main()

"""What output costs: the time in a recorder as a share of the run, and what it does to steps.

A bar is pushed sideways at its end and swings. Two runs of it take their steps in turn: one with a
recorder at its default interval, one without any. Then the same with nine tenths of the bar rigid,
where a step is cheap and its output is not. The time of a row of the history and of the fields of
one time, with and without stresses, are told apart.

    ./fenicsx python3 demos/benchmarks/output.py --unknowns 27000
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


def scene(unknowns: int, *rigid: rigidfx.Rigid) -> rigidfx.Scene:
    """A bar ten times as long as thick with about so many unknowns."""
    across = max(1, round((unknowns / 30) ** (1 / 3)))
    along = max(2, round(unknowns / (3 * (across + 1) ** 2)) - 1)
    bar = rigidfx.box((0, 0, 0), (along, across, across), (along, across, across))
    bar = bar.with_cells("rest", lambda x: x[0] <= 0.9 * along + 1e-9)
    return rigidfx.Scene(bar, MATERIAL, [rigidfx.Traction("x1", (0.0, 2.0, 3.0)), *rigid])


def measure(problem: rigidfx.Scene, steps: int, folder: Path) -> dict[str, object]:
    """Steps of a run with a recorder and of one without, in turn."""
    plain, recorded = (
        rigidfx.simulate(problem, DT, DT * (steps + 2), progress=False) for _ in range(2)
    )
    seconds: dict[str, list[float]] = {"plain": [], "recorded": [], "write": []}
    with rigidfx.Recorder(problem, folder / "default") as recorder:
        for _ in range(3):  # the initial state and two steps to warm up
            next(plain)
            recorder.write(next(recorded))
        for _ in range(steps):
            start = perf_counter()
            next(plain)
            middle = perf_counter()
            report = next(recorded)
            end = perf_counter()
            recorder.write(report)
            seconds["plain"].append(middle - start)
            seconds["recorded"].append(end - middle)
            seconds["write"].append(perf_counter() - end)
    parts = {}
    for name, options in {
        "row": {"every": 10**9},
        "fields": {"every": 1, "stress": False},
        "fields_and_stress": {"every": 1},
    }.items():
        with rigidfx.Recorder(problem, folder / name, **options) as other:
            times = []
            for _ in range(6):
                start = perf_counter()
                other.write(report)
                times.append(perf_counter() - start)
            parts[name] = median(times[1:])
    plain.close()
    recorded.close()
    step, write = sum(seconds["recorded"]), sum(seconds["write"])
    return {
        "share_of_run": write / (write + step),
        "recorded_to_plain_step": median(
            b / a for a, b in zip(seconds["plain"], seconds["recorded"], strict=True)
        ),
        "seconds_per_step": median(seconds["recorded"]),
        "seconds_to_write": parts,
        "unknowns": report.unknowns,
    }


def main() -> None:
    """Measure both runs and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=40, help="timed steps")
    parser.add_argument("--out", type=Path, default=Path("out/output"))
    parser.add_argument("--short", action="store_true", help="1700 unknowns, few steps")
    arguments = parser.parse_args()
    if arguments.short:
        arguments.unknowns, arguments.steps = 1700, 20
    summary = {
        "flexible": measure(scene(arguments.unknowns), arguments.steps, arguments.out / "flexible"),
        "rigid": measure(
            scene(arguments.unknowns, rigidfx.Rigid("rest")),
            arguments.steps,
            arguments.out / "rigid",
        ),
    }
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    assert summary["rigid"]["unknowns"] < summary["flexible"]["unknowns"]


if __name__ == "__main__":
    main()

"""What each effect costs: a step with it against the bare step, alone and together.

A bar flies and bends. Runs with one effect each, with all of them, and with all of them after their
time windows have closed take their steps in turn, so that a change of the machine's speed hits them
alike. What a scene does not call for, or no longer, costs nothing: the last of these is as fast as
the bare one.

    ./fenicsx python3 demos/benchmarks/effects.py --unknowns 27000

`ratio_per_step` includes Newton iterations that an effect may add or save; `ratio_per_iteration`
does not.
"""

from __future__ import annotations

import argparse
import json
import sys
from math import inf
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import rigidfx

MATERIAL = rigidfx.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)  # Pa, 1, kg/m³
DT = 0.1  # s
WARM = 3  # steps before the timing; windows that close do so after the first


def effects(until: float) -> dict[str, rigidfx.effects.Effect]:
    """One effect of each kind; those with a time window act until a time [s]."""
    return {
        "Traction": rigidfx.Traction("x1", (0.0, 2.0, 3.0), until=until),
        "Gravity": rigidfx.Gravity(until=until),
        "Pressure": rigidfx.Pressure("z1", 0.5, until=until),
        "KelvinVoigt": rigidfx.KelvinVoigt(20.0, until=until),
        "MassDamping": rigidfx.MassDamping(0.05, until=until),
        "NumericalDamping": rigidfx.NumericalDamping(0.05, until=until),
        "PointMass": rigidfx.PointMass("x1", 50.0),
        "Spring": rigidfx.Spring("x0", 500.0, damping=5.0),
    }


def scenes(unknowns: int) -> dict[str, rigidfx.Scene]:
    """The bare problem and those with effects, on a bar ten times as long as thick."""
    across = max(1, round((unknowns / 30) ** (1 / 3)))
    along = max(2, round(unknowns / (3 * (across + 1) ** 2)) - 1)
    bar = rigidfx.box((0, 0, 0), (along, across, across), (along, across, across))
    bend = 2e-2 * along

    def shape(x: np.ndarray) -> np.ndarray:
        return bend * np.sin(np.pi * x[0] / along) * np.array([[0.0], [0.3], [1.0]])

    moving = rigidfx.InitialVelocity(angular=(0.0, 0.0, 0.05), function=shape)
    every = effects(inf)
    closed = [e for e in effects(DT).values() if isinstance(e, rigidfx.effects.Windowed)]
    named = {
        "bare": [],
        **{name: [effect] for name, effect in every.items()},
        "all": list(every.values()),
        "all, windows closed": closed,
    }
    return {name: rigidfx.Scene(bar, MATERIAL, [moving, *own]) for name, own in named.items()}


def main() -> None:
    """Run the comparison and write its summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=10, help="timed steps")
    parser.add_argument("--out", type=Path, default=Path("out/effects"))
    parser.add_argument("--short", action="store_true", help="1700 unknowns, few steps")
    arguments = parser.parse_args()
    if arguments.short:
        arguments.unknowns, arguments.steps = 1700, 5
    end = DT * (arguments.steps + WARM)
    runs = {
        name: rigidfx.simulate(scene, DT, end, progress=False)
        for name, scene in scenes(arguments.unknowns).items()
    }
    for reports in runs.values():
        for _ in range(1 + WARM):  # the initial state first
            next(reports)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    iterations: dict[str, list[int]] = {name: [] for name in runs}
    unknowns = 0
    for _ in range(arguments.steps):
        for name, reports in runs.items():
            start = perf_counter()
            report = next(reports)
            seconds[name].append(perf_counter() - start)
            iterations[name].append(report.iterations)
            unknowns = report.unknowns
    for reports in runs.values():
        reports.close()

    bare = seconds["bare"], iterations["bare"]

    def ratio(name: str, per_iteration: bool) -> float:
        """Median over the steps of the cost against the bare step."""
        both = zip(seconds[name], iterations[name], *bare, strict=True)
        return median((t / n) / (t0 / n0) if per_iteration else t / t0 for t, n, t0, n0 in both)

    summary = {
        "unknowns": unknowns,
        "steps": arguments.steps,
        "bare_seconds_per_step": median(seconds["bare"]),
        "ratio_per_step": {name: ratio(name, False) for name in runs},
        "ratio_per_iteration": {name: ratio(name, True) for name in runs},
        "newton_per_step": {name: sum(n) / len(n) for name, n in iterations.items()},
    }
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    assert all(np.isfinite(value) for value in summary["ratio_per_step"].values())


if __name__ == "__main__":
    main()

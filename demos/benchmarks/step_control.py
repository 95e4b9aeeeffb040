"""Δt by its error: what was asked, what it was, what was estimated, and what a constant Δt does.

A bar of eight cells under eight kinds of loads, all flexible. Each scene runs with budgets of
`StepControl`, each time beside a constant Δt of as many steps. Errors are those of the tip, the
largest in time, over the largest displacement; the reference has a constant Δt of a quarter of the
median of those taken for the smallest budget, and `reference` is its own error (by Δt and Δt/2).

    ./fenicsx python3 demos/benchmarks/step_control.py --only sine
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from bench import Parser, chosen, conclude, timed
from scipy.interpolate import CubicHermiteSpline

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³
BASE = rf.Fixed("x0")
T_END = 16.0  # s
LARGEST = 0.5  # s
BUDGETS = 0.1, 0.03, 0.01
Array = np.ndarray


def ramped(t: float, period: float) -> float:
    """A sine that begins gently."""
    return float(np.sin(2 * np.pi * t / period) * min(1.0, t / period))


def swell(t: float) -> float:
    """A smooth push between 2 s and 8 s."""
    return float(np.sin(np.pi * (t - 2) / 6) ** 2) if 2 < t < 8 else 0.0


def accelerogram() -> rf.Table:
    """Numbers at random, smoothed over a second, one each 0.05 s."""
    t = np.arange(0, T_END + 0.01, 0.05)
    noise = np.random.default_rng(3).standard_normal(len(t) + 20)
    smooth = np.convolve(noise, np.hanning(21), "same")[: len(t)]
    return rf.Table(tuple(t), tuple(0.3 * smooth * np.minimum(1, t / 2)))


def path(t: float) -> tuple[float, float, float]:
    """How a base moves [m]."""
    return 0.0, 0.0, 0.05 * ramped(t, 3.0)


def push(force: float, time: Callable[[float], float] | None = None, **window: float) -> rf.Effect:
    """A lateral pull at the end [Pa]."""
    return rf.Traction("x1", (0, 0, force), time=time, **window)


SCENES: dict[str, Callable[[], list[rf.effects.Effect]]] = {
    "push": lambda: [BASE, push(200.0, lambda t: float(np.sin(np.pi * t / 2)), until=2.0)],
    "sine": lambda: [BASE, push(100.0, lambda t: ramped(t, 4.0))],
    "tumble": lambda: [rf.InitialVelocity(angular=(0.3, 1.0, 0.5))],
    "moving base": lambda: [rf.PrescribedMotion("x0", displacement=path)],
    "accelerogram": lambda: [BASE, rf.Gravity((0, 0, 1.0), time=accelerogram())],
    "blow on a body at rest": lambda: [BASE, push(2000.0, since=8.0, until=8.1)],
    "spin-up": lambda: [
        rf.Traction(face, (sign * 30.0, 0, 0), time=swell)
        for face, sign in (("y1", -1.0), ("y0", 1.0))
    ],
    "pressure": lambda: [BASE, rf.Pressure("z0", 30.0, since=1.0)],
}


@dataclass(frozen=True)
class Path:
    """The tip's displacement in a run, shape (steps, 3) [m]."""

    t: Array
    u: Array
    last: rf.Report

    def error(self, other: Path) -> float:
        """Largest distance from another, finer path [m]."""
        slope = np.gradient(other.u, other.t, axis=0)
        fine = CubicHermiteSpline(other.t, other.u, slope)
        return float(np.linalg.norm(self.u - fine(self.t), axis=1).max())


def run(name: str, dt: float | rf.StepControl) -> Path:
    """A run of a scene."""
    box = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
    scene = rf.Scene(box, SOFT, SCENES[name](), probes={"tip": (8, 0.5, 0.5)})
    reports = list(rf.simulate(scene, dt, T_END, progress=False))
    u = np.array([report.probes["tip"] for report in reports])
    return Path(np.array([report.t for report in reports]), u, reports[-1])


def measure(name: str, budgets: tuple[float, ...]) -> list[dict[str, object]]:
    """All runs of a scene."""
    ours = {
        b: timed(lambda b=b: run(name, rf.StepControl(b, "tip", largest=LARGEST))) for b in budgets
    }
    finest = float(np.median(np.diff(ours[min(budgets)][1].t)))
    reference = run(name, finest / 4)
    own = run(name, finest / 2).error(reference) / 3
    size = float(np.linalg.norm(reference.u, axis=1).max())
    rows = []
    for budget, (wall, found) in ours.items():
        steps, error = len(found.t) - 1, found.error(reference)
        wall_constant, constant = timed(lambda n=steps: run(name, T_END / n))
        ledger = found.last.ledger
        assert ledger is not None
        rows.append(
            {
                "scene": name,
                "budget": budget,
                "measured": error / size,
                "estimate": ledger.time.relative,
                "reference": own / size,
                "wall": wall,
                "steps": steps,
                "rejected": ledger.rejected,
                "lengths": len(np.unique(np.diff(found.t).round(9))),
                "constant": constant.error(reference) / size,
                "wall_constant": wall_constant,
            }
        )
    return rows


def main() -> None:
    """Run the scenes and write the summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="two scenes, two budgets")
    parser.add_only("scenes")
    options = parser.read()
    summary = []
    for name in chosen(options, SCENES, short=["push", "tumble"]):
        for row in measure(name, BUDGETS[:2] if options.short else BUDGETS):
            summary.append(row)
            print(row)
    conclude(options.out, summary)
    assert all(row["measured"] < 1.5 * row["budget"] for row in summary)


if __name__ == "__main__":
    main()

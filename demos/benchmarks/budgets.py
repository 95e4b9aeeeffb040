"""Budgets of `Accuracy` and `StepControl`: measured and estimated errors, and cost.

Each scene runs with each budget, beside a `StepControl`, nothing rigid: what `Accuracy` does by
itself with so few unknowns, unless a small bar stands for a large one (`min_cells`). Its numbers
end in `_flexible`; a constant Δt of as many steps errs by `constant_flexible`.

`measured` is the largest distance of the probe from where it is in the reference, all flexible, on
the same mesh, with steps a quarter as long as the sharpest budget would have them (`--short`: half
as long), over its largest displacement; `reference` is the reference's own error, by steps twice
as long. `estimate` is the sum of what the ledger says of time integration and of rigid parts, both
relative; `rigidity` the latter, and `sure` what it is. `wall` is the time of the run [s].

Scenes are the three structures of the study of accuracy, and a bar under loads of nine kinds.
Damping is by a viscosity that does not depend on Δt (a numerical one would change with it, and a
finer run be another structure).

    ./fenicsx python3 demos/benchmarks/budgets.py --only frame
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from bench import RAMP, Parser, chosen, conclude, pushed_l, timed
from bench.waking_scenes import BASE, push, scene, stalk_and_block
from bench.waking_scenes import CASES as WAKING
from common.machines import block_thrown, frame_shocked
from scipy.interpolate import CubicHermiteSpline

import rigidfx as rf
from meshes.tumbling_l import tumbling_l

BUDGETS = 0.05, 0.01, 0.002


@dataclass(frozen=True)
class Case:
    """A scene with a probe "tip"."""

    scene: Callable[[], rf.Scene]  # the problem
    largest: float  # largest Δt [s]
    t_end: float  # end [s]
    # least cells of a body, in place of those that are worth it: a small bar stands for a large one
    min_cells: int | None = None
    budgets: tuple[float, ...] = BUDGETS  # the budgets that its references allow


def viscous(beta: float) -> rf.StiffnessDamping:
    """The stress β ℂ:ΔE/Δt, which the numerical damping ξ = β/Δt makes [s]."""
    return rf.StiffnessDamping(ratio=beta * np.pi, frequency=1.0)


def body() -> rf.Scene:
    """The block with a cantilever, thrown into a turn."""
    return block_thrown(viscous(0.025))


def frame() -> rf.Scene:
    """The plate on four columns, under a shock."""
    return frame_shocked(3, viscous(0.00125), until=0.05)


def tumbling(refine: int = 1) -> rf.Scene:
    """The L, pushed and let go."""
    probes = {"tip": (0.0, 10.0, 1.5)}
    return pushed_l(tumbling_l(refine), time=RAMP, until=5.0, probes=probes)


def bar(*effects: rf.effects.Effect, drag: float = 1.0) -> rf.Scene:
    """A soft stalk with a stiff block on it."""
    damped = [*effects, rf.MassDamping(drag)] if drag else effects
    return scene(stalk_and_block((16, 2, 2), 4.0), *damped)


def arch(t: float) -> float:
    """Half a sine until 2 s."""
    return float(np.sin(np.pi * t / 2))


def quake() -> rf.Table:
    """Numbers at random, smoothed over a second, one each 0.05 s."""
    t = np.arange(0, 16.01, 0.05)
    noise = np.random.default_rng(3).standard_normal(len(t) + 20)
    smooth = np.convolve(noise, np.hanning(21), "same")[: len(t)]
    return rf.Table(tuple(t), tuple(0.3 * smooth * np.minimum(1, t / 2)))


def on_bar(scene: Callable[[], rf.Scene], budgets: tuple[float, ...] = BUDGETS) -> Case:
    """A case of the bar."""
    return Case(scene, 0.2, 16.0, 8, budgets)


def of_waking(name: str) -> Case:
    """One of the cases of `waking.py`."""
    return on_bar(lambda: WAKING[name].build(2))


def resonance() -> rf.Scene:
    """A sine with the period of the first bending, which grows for five of them."""
    return bar(BASE, push(5.0, lambda t: float(np.sin(2 * np.pi * t / 11.46))), drag=0.1)


CASES = {
    "frame": Case(frame, 0.02, 1.25),
    "tumbling L": Case(tumbling, 0.4, 20.0),
    "free-flying body": Case(body, 0.4, 30.0),
    "sine": of_waking("sine on a block"),
    "push": on_bar(lambda: bar(BASE, rf.Traction("x1", (0, 0, 200.0), time=arch, until=2.0))),
    "free bar": on_bar(
        lambda: bar(rf.InitialVelocity(angular=(0.3, 1.0, 0.5)), viscous(0.005), drag=0.0),
        BUDGETS[:2],
    ),
    "shock at rest": on_bar(
        lambda: bar(BASE, rf.Traction("x1", (0, 0, 2000.0), since=4.0, until=4.1)), BUDGETS[:2]
    ),
    "spin-up": of_waking("spin-up"),
    "resonance": Case(resonance, 0.5, 60.0, 8, BUDGETS[:2]),
    "moving base": of_waking("shaken base"),
    "pressure": on_bar(lambda: bar(BASE, rf.Pressure("z0", 30.0, since=1.0))),
    "accelerogram": on_bar(lambda: bar(BASE, rf.Gravity((0, 0, 1.0), time=quake()))),
}


# Runs ---------------------------------------------------------------------------------------------

FINER, FINER_SHORT = 4, 2  # steps of the reference; it is compared with half as many
Array = np.ndarray


@dataclass(frozen=True)
class Path:
    """The probe's displacement in a run, shape (steps, 3) [m], and unknowns of each step."""

    t: Array
    u: Array
    unknowns: Array
    last: rf.Report

    @property
    def size(self) -> float:
        """Largest displacement [m]."""
        return float(np.linalg.norm(self.u, axis=1).max())

    @property
    def mean_unknowns(self) -> float:
        """In the mean over time."""
        return float(np.dot(np.diff(self.t), self.unknowns[1:]) / self.t[-1])

    def error(self, finer: "Path") -> float:
        """Largest distance from a finer path, over its largest displacement."""
        slope = np.gradient(finer.u, finer.t, axis=0)
        fine = CubicHermiteSpline(finer.t, finer.u, slope)
        return float(np.linalg.norm(self.u - fine(self.t), axis=1).max()) / finer.size


def run(case: Case, dt: float | rf.StepControl, **more: object) -> Path:
    """A run of a scene."""
    rows = []
    for report in rf.simulate(case.scene(), dt, case.t_end, progress=False, **more):
        rows.append((report.t, report.probes["tip"], report.unknowns))
    t, u, unknowns = map(np.array, zip(*rows, strict=True))
    return Path(t, u, unknowns, report)


def measure(name: str, budgets: tuple[float, ...], finer: int = FINER) -> list[dict[str, Any]]:
    """All runs of a scene."""
    case = CASES[name]
    brief = replace(case, t_end=case.t_end / 20)

    def asked(case: Case, budget: float) -> Path:
        accuracy = rf.Accuracy(budget, "tip", min_cells=case.min_cells)
        return run(case, case.largest, accuracy=accuracy)

    def fine(factor: float) -> rf.StepControl:
        tol, largest = min(budgets) / factor**2, case.largest / factor
        return rf.StepControl(tol, "tip", largest=largest, smallest=1e-4 * largest)

    asked(brief, max(budgets))  # forms are read
    reference, coarser = run(case, fine(finer)), run(case, fine(finer / 2))
    own = coarser.error(reference) / 3
    rows = []
    for budget in budgets:
        control = rf.StepControl(budget, "tip", largest=case.largest)
        wall, found = timed(lambda b=budget: asked(case, b))
        wall_flexible, flexible = timed(lambda c=control: run(case, c))
        ledger, fewer = found.last.ledger, len(flexible.t) - 1
        assert ledger is not None
        rows.append(
            {
                "scene": name,
                "budget": budget,
                "measured": found.error(reference),
                "estimate": float(ledger.time.relative + ledger.rigidity.relative),
                "rigidity": float(ledger.rigidity.relative),
                "sure": ledger.sure,
                "reference": own,
                "measured_flexible": flexible.error(reference),
                "estimate_flexible": float(flexible.last.ledger.time.relative),
                "constant_flexible": run(case, case.t_end / fewer).error(reference),
                "wall": wall,
                "wall_flexible": wall_flexible,
                "mean_unknowns": found.mean_unknowns,
                "unknowns": int(found.unknowns[0]),
                "steps": len(found.t) - 1,
                "steps_flexible": fewer,
                "rejected": ledger.rejected,
            }
        )
    return rows


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], short="two structures")
    parser.add_only("scenes")
    parser.add_argument("--budgets", default=",".join(map(str, BUDGETS)), help="parts of one")
    options = parser.read()
    budgets = tuple(float(word) for word in options.budgets.split(","))
    summary = []
    for name in chosen(options, CASES, short=["frame", "tumbling L"]):
        finer = FINER_SHORT if options.short else FINER
        own = tuple(b for b in budgets if b in CASES[name].budgets) or CASES[name].budgets
        for row in measure(name, own, finer):
            summary.append(row)
            print(row)
    conclude(options.out, summary)
    for row in summary:
        assert row["measured"] <= row["budget"] + 2 * row["reference"], row
        assert row["measured_flexible"] < 1.5 * row["budget"], row

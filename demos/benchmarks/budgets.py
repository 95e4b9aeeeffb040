"""Budgets of `Accuracy` and `StepControl`: measured and estimated errors, and cost.

Each scene runs with each budget, beside

- `wall_flexible`: a `StepControl`, nothing rigid; what `Accuracy` does by itself with so few
  unknowns, unless a small bar stands for a large one (`min_cells`). `measured_flexible` and
  `estimate_flexible` are its errors; a constant Δt of as many steps errs by `constant_flexible`;
- `wall_best_by_hand`: the fastest of runs with Δt and rigid parts set by hand, Δt a constant of
  half as many steps or, where that errs by more, of 0.7 times or of as many, with a tolerance and
  without; of those that err by no more than the automatic run, or a tenth more; null if none does.
  `by_hand` names it. `wall_best_flexible`: of those that err by no more than the flexible one.

With runs by hand all are medians of three runs each, which take turns, as runs of less than a
second differ by a fifth from each other.

`measured` is the largest distance of the probe from where it is in the reference, all flexible, on
the same mesh, with steps a quarter as long as the sharpest budget would have them (`--short`: half
as long), over its largest displacement; `reference` is the reference's own error, by steps twice
as long. `estimate` is
the sum of what the ledger says of time integration and of rigid parts, both relative; `rigidity`
the latter, and `sure` what it is.

At the end the times over those by hand are told in the geometric mean and at most: of all runs as
they are, where bodies in a bar of 405 unknowns cost more than they save, and of what `Accuracy`
chooses if nobody names `min_cells`.

    ./fenicsx python3 demos/benchmarks/budgets.py --only frame
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from bench import Parser, chosen, conclude, in_turn, timed
from bench.budget_scenes import BUDGETS, CASES, Case
from scipy.interpolate import CubicHermiteSpline

import rigidfx as rf

NEAR = 1.1  # times the error of the automatic run that one set by hand may have
FINER, FINER_SHORT = 4, 2  # steps of the reference; it is compared with half as many
FACTORS = 2.0, 1.4, 1.0  # of Δt by hand, over the mean of the automatic run
TIMES = 3  # that each run is timed
HAND = "wall", "wall_best_by_hand"
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

    def error(self, finer: Path) -> float:
        """Largest distance from a finer path, over its largest displacement."""
        slope = np.gradient(finer.u, finer.t, axis=0)
        fine = CubicHermiteSpline(finer.t, finer.u, slope)
        return float(np.linalg.norm(self.u - fine(self.t), axis=1).max()) / finer.size


Run = Callable[[], Path]


def run(case: Case, dt: float | rf.StepControl, **more: object) -> Path:
    """A run of a scene."""
    rows = []
    for report in rf.simulate(case.scene(), dt, case.t_end, progress=False, **more):
        rows.append((report.t, report.probes["end"], report.unknowns))
    t, u, unknowns = map(np.array, zip(*rows, strict=True))
    return Path(t, u, unknowns, report)


def by_hand(case: Case, steps: int, reference: Path, allowed: float) -> tuple[str, Run] | None:
    """The fastest run with a constant Δt that errs by no more than allowed, and what it is.

    With rigid parts and without; with more steps only where fewer do not do.
    """
    rule = rf.StrainRate(case.tol, case.window, wake=case.wake)
    good: dict[tuple[str, Run], float] = {}
    for words, rigidify in (("flexible", None), ("rigid parts", rule)):
        for factor in FACTORS:
            dt = case.t_end / max(round(steps / factor), 1)
            tried = partial(run, case, dt, rigidify=rigidify)
            wall, path = timed(tried)
            if path.error(reference) <= allowed:
                good[f"{words}, Δt = {dt:.3g} s", tried] = wall
                break
    return min(good, key=lambda found: good[found], default=None)


def measure(
    name: str, budgets: tuple[float, ...], hand: bool, finer: int = FINER
) -> list[dict[str, Any]]:
    """All runs of a scene."""
    case = CASES[name]
    brief = replace(case, t_end=case.t_end / 20)

    def asked(case: Case, budget: float) -> Path:
        accuracy = rf.Accuracy(budget, "end", min_cells=case.min_cells)
        return run(case, case.largest, accuracy=accuracy)

    def fine(factor: float) -> rf.StepControl:
        tol, largest = min(budgets) / factor**2, case.largest / factor
        return rf.StepControl(tol, "end", largest=largest, smallest=1e-4 * largest)

    asked(brief, max(budgets))  # forms are read
    reference, coarser = run(case, fine(finer)), run(case, fine(finer / 2))
    own = coarser.error(reference) / 3
    rows = []
    for budget in budgets:
        control = rf.StepControl(budget, "end", largest=case.largest)
        runs: dict[str, Run] = {
            "wall": partial(asked, case, budget),
            "wall_flexible": partial(run, case, control),
        }
        first = {key: timed(each) for key, each in runs.items()}
        (_, found), (_, flexible) = first.values()
        ledger, steps = found.last.ledger, len(found.t) - 1
        assert ledger is not None
        error = found.error(reference)
        loose, fewer = flexible.error(reference), len(flexible.t) - 1
        best = by_hand(case, steps, reference, NEAR * error) if hand else None
        other = best
        if hand and case.min_cells:
            other = by_hand(case, fewer, reference, NEAR * loose)
        constant = run(case, case.t_end / fewer).error(reference) if hand else None
        for key, fastest in {"wall_best_by_hand": best, "wall_best_flexible": other}.items():
            if fastest is not None:
                runs[key] = fastest[1]
        walls = in_turn(runs, TIMES) if hand else {key: wall for key, (wall, _) in first.items()}
        rows.append(
            {
                "scene": name,
                "budget": budget,
                "measured": error,
                "estimate": float(ledger.time.relative + ledger.rigidity.relative),
                "rigidity": float(ledger.rigidity.relative),
                "sure": ledger.sure,
                "reference": own,
                "measured_flexible": loose,
                "estimate_flexible": float(flexible.last.ledger.time.relative),
                "constant_flexible": constant,
                "wall": walls["wall"],
                "wall_flexible": walls["wall_flexible"],
                "wall_best_by_hand": walls.get("wall_best_by_hand"),
                "wall_best_flexible": walls.get("wall_best_flexible"),
                "by_hand": None if best is None else best[0],
                "mean_unknowns": found.mean_unknowns,
                "unknowns": int(found.unknowns[0]),
                "steps": steps,
                "steps_flexible": fewer,
                "rejected": ledger.rejected,
            }
        )
    return rows


def told(summary: list[dict[str, Any]]) -> str:
    """Times over those of the best by hand, with the bodies of `Case.min_cells` and without."""
    lines = []
    for words, own in (("with min_cells of the cases", False), ("as Accuracy chooses", True)):
        ratios = []
        for row in summary:
            flexible = own and CASES[row["scene"]].min_cells is not None
            keys = ("wall_flexible", "wall_best_flexible") if flexible else HAND
            if row[keys[1]] is not None:
                ratios.append(row[keys[0]] / row[keys[1]])
        if ratios:
            mean = float(np.exp(np.mean(np.log(ratios))))
            lines.append(f"{words}: {mean:.2f} of the best by hand, at most {max(ratios):.2f}")
    return "\n".join(lines)


def main() -> None:
    """Run the scenes and write the summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="two structures")
    parser.add_only("scenes")
    parser.add_argument("--no-hand", action="store_true", help="nothing set by hand beside it")
    parser.add_argument("--budgets", default=",".join(map(str, BUDGETS)), help="parts of one")
    options = parser.read()
    budgets = tuple(float(word) for word in options.budgets.split(","))
    summary = []
    for name in chosen(options, CASES, short=["frame", "tumbling L"]):
        finer = FINER_SHORT if options.short else FINER
        own = tuple(b for b in budgets if b in CASES[name].budgets) or CASES[name].budgets
        for row in measure(name, own, not options.no_hand, finer):
            summary.append(row)
            print(row)
    print(told(summary))
    conclude(options.out, summary)
    for row in summary:
        assert row["measured"] <= row["budget"] + 2 * row["reference"], row
        assert row["measured_flexible"] < 1.5 * row["budget"], row


if __name__ == "__main__":
    main()

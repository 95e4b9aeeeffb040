"""Budgets of `Accuracy` and `StepControl`: measured and estimated errors, and cost.

Each scene runs with each budget, beside a `StepControl`, nothing rigid: what `Accuracy` does by
itself with so few unknowns, unless a small bar stands for a large one (`min_cells`). Its numbers
end in `_flexible`; a constant Δt of as many steps errs by `constant_flexible`.

`measured` is the largest distance of the probe from where it is in the reference, all flexible, on
the same mesh, with steps a quarter as long as the sharpest budget would have them (`--short`: half
as long), over its largest displacement; `reference` is the reference's own error, by steps twice
as long. `estimate` is the sum of what the ledger says of time integration and of rigid parts, both
relative; `rigidity` the latter, and `sure` what it is. `wall` is the time of the run [s].

    ./fenicsx python3 demos/benchmarks/budgets.py --only frame
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from bench import Parser, chosen, conclude, timed
from bench.budget_scenes import BUDGETS, CASES, Case
from scipy.interpolate import CubicHermiteSpline

import rigidfx as rf

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

    def error(self, finer: Path) -> float:
        """Largest distance from a finer path, over its largest displacement."""
        slope = np.gradient(finer.u, finer.t, axis=0)
        fine = CubicHermiteSpline(finer.t, finer.u, slope)
        return float(np.linalg.norm(self.u - fine(self.t), axis=1).max()) / finer.size


def run(case: Case, dt: float | rf.StepControl, **more: object) -> Path:
    """A run of a scene."""
    rows = []
    for report in rf.simulate(case.scene(), dt, case.t_end, progress=False, **more):
        rows.append((report.t, report.probes["end"], report.unknowns))
    t, u, unknowns = map(np.array, zip(*rows, strict=True))
    return Path(t, u, unknowns, report)


def measure(name: str, budgets: tuple[float, ...], finer: int = FINER) -> list[dict[str, Any]]:
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


def main() -> None:
    """Run the scenes and write the summary."""
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


if __name__ == "__main__":
    main()

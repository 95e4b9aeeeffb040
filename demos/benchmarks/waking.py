"""Rigid while loads act: what waking by forces finds, misses, and costs, against flexible twins.

Each scene runs fully flexible and with `StrainRate(…, wake="local")`, the two in turn, and the
strain rates of the flexible twin judge the other run, in windows of 20 steps:

- needed: cell-windows in which the twin strains at more than twice κ tol; missed: the share of
  them in which the cell was rigid when the twin crossed that and one step later;
- woken: cells above the threshold, without the ring round them; false: the share of them that
  stays below tol in the twin for two windows from then on;
- released: all cells that become flexible, with rings, bodies that are released whole, what
  drifted and freezes that are undone; released_quiet: the share of them that stays below tol;
- quiet_share: cell-windows below tol in the twin; rigid_share: rigid time × cells;
- error of the probe relative to its largest displacement, and of the energy;
- time_ratio: wall time over that of the twin; prediction_share: the part of it in which shadows
  take their steps; shadow_factor_share: that in which they are made and factored;
  deviation_share: that in which it is followed how far the run is off, factors included (zero
  where nobody follows it);
- repeats: steps solved twice, as the check found what the prediction had not, or a freeze that
  would not last.

With --oracle that of Mercier-Aubin et al. 2022 is asked in each step, too (`bench/oracle.py`).

    ./fenicsx python3 demos/benchmarks/waking.py --across 6
    ./fenicsx python3 demos/benchmarks/waking.py --across 6 --only gong    # in parts
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
from bench import Parser, Turns, chosen, conclude
from bench.oracle import Oracle, judged_oracle
from bench.waking_scenes import CASES, Case
from petsc4py import PETSc

import rigidfx as rf
from rigidfx.decide.reasons import CHECKED, UNDONE

KAPPA = 3.0
WINDOW = 20  # steps
EVENTS = {  # PETSc's log, by what the summary calls a part of the run
    "prediction_share": "rigidfxShadow",
    "shadow_factor_share": "rigidfxShadowNew",
    "deviation_share": "rigidfxDeviation",
}


def seconds(name: str) -> float:
    """Time that PETSc has logged for a part of the program [s]."""
    return float(PETSc.Log.Event(name).getPerfInfo()["time"])


def peak_rate(case: Case, across: int) -> float:
    """Largest strain rate of the flexible run [1/s]."""
    nothing = rf.StrainRate(0.0, 1e9)
    run = rf.simulate(case.scene(across), case.dt, case.t_end, rigidify=nothing, progress=False)
    return max(float(report.strain_rate.max()) for report in run)


def judged(
    rates: np.ndarray, rigid: np.ndarray, ours: list[rf.Report], tol: float
) -> dict[str, float | int]:
    """Shares of cell-windows and of woken cells.

    Args:
        rates: Strain rates of the twin, shape (steps, cells) [1/s].
        rigid: Which cells were rigid at the end of each step, of the same shape.
        ours: Reports of the run with rigid parts.
        tol: Tolerance [1/s].
    """
    steps, cells = rates.shape
    quiet = needed = missed = woken = false = released = in_vain = 0
    for first in range(0, steps - WINDOW + 1, WINDOW):
        window = rates[first : first + WINDOW]
        quiet += int((window <= tol).all(axis=0).sum())
        crossing = window > 2 * KAPPA * tol
        for cell in np.flatnonzero(crossing.any(axis=0)):
            at = first + int(np.argmax(crossing[:, cell]))
            needed += 1
            missed += bool(rigid[at, cell] and rigid[min(at + 1, steps - 1), cell])
    for step, report in enumerate(ours):
        for event in report.events:
            ahead = rates[step : step + 2 * WINDOW]
            woken += event.woken.size
            false += int((ahead[:, event.woken] <= tol).all(axis=0).sum())
    for step in range(1, steps):
        left = rigid[step - 1] & ~rigid[step]
        released += int(left.sum())
        in_vain += int((rates[step : step + 2 * WINDOW, left] <= tol).all(axis=0).sum())
    return {
        "needed": needed,
        "missed": missed / max(needed, 1),
        "woken": woken,
        "false": false / max(woken, 1),
        "released": released,
        "released_quiet": in_vain / max(released, 1),
        "rigid_share": float(rigid.mean()),
        "quiet_share": quiet / (steps // WINDOW * cells),
    }


def measure(name: str, across: int, ask: bool) -> dict[str, object]:
    """Both runs of a case, and what the oracle says along ours if it is asked."""
    case = CASES[name].at(across)
    tol = case.tol * peak_rate(case, across)
    rule = rf.StrainRate(tol, WINDOW * case.dt, kappa=KAPPA)
    measuring = rf.StrainRate(0.0, 1e9, wake="none")
    before = {share: seconds(event) for share, event in EVENTS.items()}
    runs = {
        key: rf.simulate(case.scene(across), case.dt, case.t_end, rigidify=r, progress=False)
        for key, r in (("twin", measuring), ("local", rule))
    }
    rates, rigid, guesses = [], [], []
    with Turns(runs, warm=1) as turns, ExitStack() as stack:
        oracle = stack.enter_context(Oracle(case.scene(across), case.dt)) if ask else None
        for _ in range(round(case.t_end / case.dt)):
            here = rigid and rigid[-1].any()
            guess = oracle.rates(turns.reports["local"][-1]) if oracle and here else None
            turns.take()
            now = {key: reports[-1] for key, reports in turns.reports.items()}
            rates.append(now["twin"].strain_rate.copy())
            rigid.append(now["local"].state.body_numbers() > 0)
            guesses.append(np.zeros_like(rates[-1]) if guess is None else guess)
    wall = sum(turns.seconds["local"])
    spent = {share: seconds(event) - before[share] for share, event in EVENTS.items()}
    twin, ours = turns.reports["twin"], turns.reports["local"]
    found = np.array(rates), np.array(rigid)
    shares = judged(*found, ours, tol)
    asked = judged_oracle(*found, np.array(guesses), KAPPA * tol, tol, WINDOW) if ask else {}
    return {
        "scene": name,
        "unknowns": twin[-1].unknowns,
        **shares,
        "tol_over_peak": case.tol,
        **errors(ours, twin),
        "time_ratio": wall / sum(turns.seconds["twin"]),
        **{share: part / wall for share, part in spent.items()},
        "repeats": sum(
            event.reason in (CHECKED, UNDONE) for report in ours for event in report.events
        ),
        **asked,
    }


def errors(ours: list[rf.Report], twin: list[rf.Report]) -> dict[str, float]:
    """Of the tip's motion and of the energy, relative to their largest values in the twin."""
    tips = [np.array([report.probes["tip"] for report in run]) for run in (ours, twin)]
    energies = [np.array([report.energy for report in run]) for run in (ours, twin)]
    return {
        "error": float(np.abs(tips[0] - tips[1]).max() / np.abs(tips[1] - tips[1][0]).max()),
        "energy_error": float(np.abs(energies[0] - energies[1]).max() / energies[1].max()),
    }


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="some 400 unknowns")
    parser.add_argument("--across", type=int, default=6, help="cells across a bar")
    parser.add_argument("--oracle", action="store_true", help="ask another oracle beside")
    parser.add_only("scenes")
    options = parser.read(across=2)
    PETSc.Log.begin()
    summary = []
    for name in chosen(options, CASES):
        summary.append(measure(name, options.across, options.oracle))
        print(summary[-1])
    conclude(options.out, summary)
    assert all(entry["missed"] <= 0.01 for entry in summary)


if __name__ == "__main__":
    main()

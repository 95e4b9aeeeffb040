"""Rigid while loads act: what waking by forces finds, misses, and costs, against flexible twins.

Each scene runs fully flexible and with `StrainRate(…, wake="local")`, and the strain rates of the
flexible twin judge the other run, in windows of 20 steps. An entry of summary.json holds:

- missed: of the cell-windows in which the twin strains at more than twice κ tol, the share in which
  the cell was rigid when the twin crossed that, and one step later;
- woken: number of cells that forces wake, without the ring round them; in_vain: the share of them
  that stays below tol in the twin for two windows from then on;
- rigid_share: rigid time × cells; quiet_share: cell-windows below tol in the twin; rigid_of_quiet:
  the rigid share of these;
- promise: 0.8 κ tol over the twin's peak strain rate; error: that of the probe in u, over its
  largest displacement; error_corrected: the same of u + e, e the error motion; told_over_true: the
  largest |e| at the probe over the largest error of u. The last two are null where e is not known,
  told_over_true also where e and the error are below 1e-4;
- time_ratio: wall time over that of the twin; e_share: the part of it in which e is followed,
  without its set-up; setup_in_steps: matrices, modes and factors of e; switch_in_steps: time of a
  switch besides that of a step. Both are in kept steps, the twin's median step on a kept
  tangent;
- factorisations: of the matrices of e; memory: the most that the process has taken so far [MB].

With --oracle that of Mercier-Aubin et al. 2022 is asked in each step, too (`bench/oracle.py`).

    ./fenicsx python3 demos/benchmarks/waking.py --across 6
    ./fenicsx python3 demos/benchmarks/waking.py --across 6 --only gong    # in parts
    ./fenicsx python3 demos/benchmarks/waking.py --seeds 0-9               # random scenes instead
"""

from __future__ import annotations

import warnings
from argparse import ArgumentTypeError
from collections.abc import Callable
from contextlib import ExitStack
from resource import RUSAGE_SELF, getrusage

import numpy as np
from bench import Parser, chosen, conclude, timed
from bench.judged import KAPPA, WINDOW, Record, costs, errors, judged
from bench.oracle import Oracle, judged_oracle
from bench.random_waking import random_case, seeds_of
from bench.waking_scenes import CASES, Case
from bench.waking_structures import LARGE, STRUCTURES, Built
from petsc4py import PETSc

import rigidfx as rf

EVENTS = "rigidfxErrorMotion", "rigidfxErrorSetup", "rigidfxErrorFactor"  # of PETSc's log
MISSED = 0.01  # share, at most
NAMED = {**CASES, **STRUCTURES}


def logged(what: str) -> np.ndarray:
    """The "time" [s] or "count" of each of the events so far."""
    return np.array([PETSc.Log.Event(name).getPerfInfo()[what] for name in EVENTS])


def followed(
    case: Case | Built, across: int, rule: rf.StrainRate, look: Callable[[rf.Report], None]
) -> Record:
    """Run a case, and keep what is judged.

    Args:
        case: The case.
        across: Cells across a bar.
        rule: When parts become rigid.
        look: Is given each report before the next step.
    """
    run = rf.simulate(case.scene(across), case.dt, case.t_end, rigidify=rule, progress=False)
    first = next(run)
    tips, motions = [first.probes["tip"]], [first.error_motion["tip"]]
    rates, rigid, woken, switches, walls, kept = [], [], [], [], [], []
    look(first)
    while (made := timed(lambda: next(run, None)))[1] is not None:
        seconds, report = made
        walls.append(seconds)
        kept.append(report.tangents == 0)
        tips.append(report.probes["tip"])
        motions.append(report.error_motion["tip"])
        rates.append(report.strain_rate.astype(np.float32))
        rigid.append(report.state.body_numbers() > 0)
        woken.append(np.concatenate([np.zeros(0, int), *(e.woken for e in report.events)]))
        switches.append(len(report.events))
        look(report)
    return Record(
        first.unknowns,
        np.array(rates),
        np.array(rigid),
        woken,
        *map(np.array, (switches, tips, motions, walls, kept)),
    )


def measure(
    name: str, case: Case | Built, seed: int | None, across: int, ask: bool
) -> dict[str, object]:
    """Both runs of a case, and what the oracle says along ours if it is asked."""
    case = case.at(across)
    twin = followed(case, across, rf.StrainRate(0.0, 1e9, wake="none"), lambda _: None)
    tol = case.tol * float(twin.rates.max())
    rule = rf.StrainRate(tol, WINDOW * case.dt, kappa=KAPPA)
    seconds, numbers, guesses = logged("time"), logged("count"), []
    with ExitStack() as stack:
        oracle = stack.enter_context(Oracle(case.scene(across), case.dt)) if ask else None

        def guess(report: rf.Report) -> None:
            none = np.zeros_like(report.strain_rate)
            here = oracle is not None and (report.state.body_numbers() > 0).any()
            guesses.append(oracle.rates(report) if oracle and here else none)

        ours = followed(case, across, rule, guess if ask else lambda _: None)
    following, *parts = logged("time") - seconds
    setup = sum(parts)
    cost = costs(twin, ours)
    asked = (KAPPA * tol, tol, WINDOW)
    return {
        "scene": name,
        "seed": seed,
        "unknowns": twin.unknowns,
        **judged(twin, ours, tol),
        "promise": 0.8 * KAPPA * case.tol,
        **errors(twin, ours),
        "time_ratio": cost["time_ratio"],
        "e_share": float((following - setup) / ours.walls.sum()),
        "setup_in_steps": float(setup / twin.kept_step),
        "switch_in_steps": cost["switch_in_steps"],
        "factorisations": int((logged("count") - numbers)[-1]),
        "memory": getrusage(RUSAGE_SELF).ru_maxrss // 1024,
        **(judged_oracle(twin.rates, ours.rigid, np.array(guesses[:-1]), *asked) if ask else {}),
    }


def seeds(text: str) -> list[int]:
    """Numbers of random scenes, for --seeds."""
    try:
        return seeds_of(text)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} should be numbers such as 0-9,12") from None


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="some 400 unknowns, no large scenes")
    parser.add_argument("--across", type=int, default=6, help="cells across a bar")
    parser.add_argument("--oracle", action="store_true", help="ask another oracle beside")
    parser.add_argument("--seeds", type=seeds, help="random scenes instead, such as 0-9,12")
    parser.add_only("scenes")
    options = parser.read(across=2)
    warnings.simplefilter("ignore", rf.RigidfxWarning)
    PETSc.Log.begin()
    if options.seeds:
        cases = [(*random_case(seed), seed) for seed in options.seeds]
    else:
        every = NAMED if options.short else {**NAMED, **LARGE}
        cases = [(name, every[name], None) for name in chosen(options, every)]
    summary = []
    for name, case, seed in cases:
        summary.append(measure(name, case, seed, options.across, options.oracle))
        print(summary[-1], flush=True)
    conclude(options.out, summary)
    assert all(entry["missed"] <= MISSED for entry in summary)


if __name__ == "__main__":
    main()

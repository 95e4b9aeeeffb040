"""What a step with rigid parts costs: against the ideal, and against the fully flexible step.

A bar is pushed sideways at its end. Most of it is one rigid body; the *ideal* is a run of the
flexible cells alone with their cut face held: no condensation can be cheaper than leaving the rest
of the structure out. All three runs take their steps in turn, so that a change of the machine's
speed hits them alike; the first two take ten for one of the flexible run, which costs as much. Each
uses the solver that rigidfx chooses for it.

    ./fenicsx python3 demos/benchmarks/condensation.py --unknowns 27000 --rigid 0.9

`ratio_to_ideal` compares per Newton iteration, `ratio_to_flexible` per step. `ideal_to_flexible` is
what the flexible cells alone take of the flexible step: with rigid parts it cannot take less.
`--rigid 1` has six unknowns left and no ideal.
"""

from __future__ import annotations

from bench import DT, MATERIAL, PUSH, Parser, Turns, bar, cells_of_bar, conclude

import rigidfx

PAIRS = 10  # steps of the condensed and the ideal run for one of the flexible run


def scenes(along: int, across: int, rigid: int) -> dict[str, rigidfx.Scene]:
    """The condensed, the fully flexible and the ideal problem."""
    whole = bar(along, across)
    stiff = whole.with_cells("stiff", lambda x: x[0] <= rigid + 1e-9)
    out = {
        "condensed": rigidfx.Scene(stiff, MATERIAL, [PUSH, rigidfx.Rigid("stiff")]),
        "flexible": rigidfx.Scene(whole, MATERIAL, [PUSH]),
    }
    if rigid < along:
        rest = bar(along - rigid, across)
        out["ideal"] = rigidfx.Scene(rest, MATERIAL, [PUSH, rigidfx.Fixed("x0")])
    return out


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="1700 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000, help="of the flexible bar")
    parser.add_argument("--rigid", type=float, default=0.9, help="part of the cells, 0 … 1")
    parser.add_argument("--steps", type=int, default=9, help="timed steps of the flexible bar")
    options = parser.read(unknowns=1700, steps=3)
    along, across = cells_of_bar(options.unknowns)
    rigid = min(round(options.rigid * along), along)
    runs = {
        name: rigidfx.simulate(scene, DT, 1e6, progress=False)
        for name, scene in scenes(along, across, rigid).items()
    }
    cheap = [name for name in runs if name != "flexible"]
    with Turns(runs) as turns:
        for _ in range(options.steps):
            turns.take("flexible")
            for _ in range(PAIRS):
                turns.take(*cheap)
    last = {name: reports[-1] for name, reports in turns.reports.items()}
    newton = {name: turns.newton(name) for name in runs}
    ideal = turns.ratio("condensed", "ideal", per_iteration=True) if "ideal" in runs else None
    summary = {
        "ratio_to_ideal": ideal,
        "ratio_to_flexible": turns.ratio("condensed", "flexible"),
        "ideal_to_flexible": turns.ratio("ideal", "flexible") if "ideal" in runs else None,
        "newton_per_step": newton,
        "unknowns": last["flexible"].unknowns,
        "unknowns_reduced": last["condensed"].unknowns,
        "rigid_cells": rigid / along,
        "seconds_per_step": {name: turns.median(name) for name in runs},
        "linear_iterations": {name: report.linear_iterations for name, report in last.items()},
        "solvers": {name: report.solver for name, report in last.items()},
    }
    conclude(options.out, summary)
    # Condensing must not cost Newton iterations, or it is not exact.
    assert newton["condensed"] <= newton["flexible"] + 1


if __name__ == "__main__":
    main()

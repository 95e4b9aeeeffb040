"""What it costs to look for rigid parts: a step that is observed against one that is not.

A bar is pushed sideways at its end. Two runs of it take their steps in turn; the one observes the
strain rate of every cell, records its signals and decides at the end of each window, but nothing
ever qualifies. A third run freezes and releases nine tenths of the bar a few times: what a switch
costs is told in steps. The last two are all flexible, and in the one nine tenths of the cells bear
a stress that fades, as after a release by forces; to assemble that once is told in steps. What the
error motion takes is told by waking.py (`e_share`).

    ./fenicsx python3 demos/benchmarks/observation.py --unknowns 27000
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from statistics import median

import numpy as np
from bench import DT, MATERIAL, PUSH, Parser, Turns, bar, cells_of_bar, conclude, timed

import rigidfx
from rigidfx.mechanics.eased import Eased
from rigidfx.preparation import prepare
from rigidfx.run import Run
from rigidfx.scene.timeline import Timeline
from rigidfx.step.step_result import StepResult
from rigidfx.switch.inventory import divide

WINDOW = 5  # steps


def scene(unknowns: int) -> rigidfx.Scene:
    """A bar with about so many unknowns, whose last tenth may be kept flexible."""
    along, across = cells_of_bar(unknowns)
    domain = bar(along, across).with_cells("end", lambda x: x[0] >= 0.9 * along - 1e-9)
    return rigidfx.Scene(domain, MATERIAL, [PUSH])


def switches(problem: rigidfx.Scene, usual: float) -> dict[str, list[float]]:
    """What freezes and releases take [s], by kind, where a step takes `usual` [s]."""
    everything = rigidfx.StrainRate(
        1e9,
        WINDOW * DT,
        never="end",
        patience=1,
        release=rigidfx.Release(at=[(2 * k + 2) * WINDOW * DT for k in range(3)]),
    )
    found: dict[str, list[float]] = {"freeze": [], "release": []}
    end = 6.5 * WINDOW * DT
    for report in rigidfx.simulate(problem, DT, end, rigidify=everything, progress=False):
        for event in report.events[:1]:
            # Of a freeze the step before it is part of the time, of a release it is not.
            found[event.kind].append(report.wall - (usual if event.kind == "freeze" else 0.0))
    return found


def eased(unknowns: int, steps: int) -> dict[str, float]:
    """What a step takes while nine tenths of the bar are let down, and how that begins."""
    along, across = cells_of_bar(unknowns)
    problem = rigidfx.Scene(bar(along, across), MATERIAL, [PUSH])
    with ExitStack() as stack:
        runs, seconds = {}, {}
        for name in ("plain", "eased"):
            run, _ = prepare(problem, Timeline(DT, 1e6))
            runs[name] = _steps(stack.enter_context(run))
            stepper, acting = run.stepper, run.switch.acting
            state = stepper.state
            if name == "eased":
                owned = problem.mesh.topology.index_map(3).size_local
                cells = np.arange(round(0.9 * owned), dtype=np.int32)
                nodes = np.unique(problem.space.dofmap.list[cells]).astype(np.int32)
                bent = 1e-7 * state.X[nodes] ** 2  # m, a small stress
                state.ease(Eased(cells, nodes, 0 * bent, bent, 0.0, 1e6))
            division = divide(problem, stepper.forces, state, (), [])
            seconds[name], _ = timed(partial(stepper.bind, division, acting))
        with Turns(runs) as turns:
            for _ in range(steps):
                turns.take()
        begins = (seconds["eased"] - seconds["plain"]) / turns.median("plain")
        return {"step_to_one_without": turns.ratio("eased", "plain"), "begins_in_steps": begins}


def _steps(run: Run) -> Iterator[StepResult]:
    """The steps of a run."""
    while True:
        yield run.advance(run.target())[0]


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="1700 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000)
    parser.add_argument("--steps", type=int, default=20, help="timed steps")
    options = parser.read(unknowns=1700, steps=10)
    problem = scene(options.unknowns)
    end = DT * (options.steps + 2)
    nothing = rigidfx.StrainRate(0.0, WINDOW * DT)
    runs = {
        "plain": rigidfx.simulate(problem, DT, end, progress=False),
        "observed": rigidfx.simulate(problem, DT, end, rigidify=nothing, progress=False),
    }
    with Turns(runs) as turns:
        for _ in range(options.steps):
            turns.take()
    usual = turns.median("plain")
    taken = switches(problem, usual)
    summary = {
        "observed_to_plain": turns.ratio("observed", "plain"),
        "seconds_per_step": {name: turns.median(name) for name in runs},
        "freeze_in_steps": median(taken["freeze"]) / usual,
        "release_in_steps": median(taken["release"]) / usual,
        "unknowns": turns.reports["observed"][-1].unknowns,
        "nine_tenths_let_down": eased(options.unknowns, options.steps),
    }
    conclude(options.out, summary)
    assert sum(map(len, taken.values())) >= 4


if __name__ == "__main__":
    main()

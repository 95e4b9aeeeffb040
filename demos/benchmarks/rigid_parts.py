"""Steps with rigid parts: beside the flexible structure, and beside its flexible cells alone.

* *chains*: a bar is pushed sideways at its end. Each of its equal segments is one rigid body but
  for its last layers of cells. The *ideal* has these layers alone, with their cuts held: no
  condensation can be cheaper. `ratio_to_flexible` compares a step, `ratio_to_ideal` and
  `ratio_to_cells` an iteration; the latter is over the share of flexible cells.
* *switches*: a step in which strain rates are observed but no cell qualifies, over a plain one; and
  in plain steps the time from the mesh to the first report, of a freeze of nine tenths, and of its
  release.

Runs take their steps in turn, so that a change of the machine's speed hits them alike.

    ./fenicsx python3 demos/benchmarks/rigid_parts.py --unknowns 27000
    ./fenicsx python3 demos/benchmarks/rigid_parts.py --along 160 --across 2 --bodies 40
"""

from argparse import Namespace
from statistics import mean, median
from typing import Any

import numpy as np
from bench import DT, MATERIAL, PUSH, Parser, Turns, bar, cells_of_bar, run_parts, timed
from common import boxes

import rigidfx as rf

LEAST_LAYERS = 2  # of flexible cells between bodies
PAIRS = 3  # steps of chains and ideals for one of the flexible bar, which takes longer
WINDOW = 5  # steps
EXACT = 3  # steps in which iterations with new tangents are counted


def chain(along: int, across: int, bodies: int, layers: int) -> rf.Scene:
    """A bar of so many cells, divided among so many bodies; flexible if none."""
    domain, rigid = bar(along, across), []
    for k in range(bodies):
        first, last = k * along / bodies, (k + 1) * along / bodies - layers
        domain = domain.with_cells(
            f"body {k + 1}",
            lambda x, first=first, last=last: (x[0] >= first - 1e-9) & (x[0] <= last + 1e-9),
        )
        rigid.append(rf.Rigid(f"body {k + 1}"))
    return rf.Scene(domain, MATERIAL, [PUSH, *rigid])


def ideal(along: int, across: int, bodies: int, layers: int) -> rf.Scene:
    """The flexible cells of a chain, held where bodies were; all are pushed sideways."""
    ends = (np.arange(bodies) + 1) * along / bodies
    size = layers, across, across
    every = boxes(*(((end - layers, 0, 0), (end, across, across), size) for end in ends))
    cuts = np.r_[ends[:-1], ends - layers]
    domain = every.with_facets("side", lambda x: x[1] >= across - 1e-9)
    domain = domain.with_facets("cuts", lambda x: np.isclose(x[0][:, None], cuts).any(axis=1))
    push = rf.Traction("side", (0.0, 0.02, 0.03))  # Pa
    return rf.Scene(domain, MATERIAL, [push, rf.Fixed("cuts")])


def iterations(scene: rf.Scene) -> float:
    """Mean iterations of Newton's method with a new tangent in each, in the first steps."""
    options = {"snes_lag_jacobian": 1}
    reports = rf.simulate(scene, DT, EXACT * DT, progress=False, petsc_options=options)
    return mean(report.iterations for report in reports if report.step)


def chains(options: Namespace) -> dict[str, Any]:
    """Each chain beside the flexible bar and its ideal."""
    along, across = cells_of_bar(options.unknowns)
    along, across = options.along or along, options.across or across
    layers = {
        n: max(LEAST_LAYERS if n > 1 else 1, round((1 - options.rigid) * along / n))
        * (options.rigid < 1)
        for n in options.bodies
    }
    scenes = {("flexible", 0): chain(along, across, 0, 0)}
    for n in options.bodies:
        scenes["chain", n] = chain(along, across, n, layers[n])
        if layers[n]:
            scenes["ideal", n] = ideal(along, across, n, layers[n])
    runs = {name: rf.simulate(scene, DT, 1e6, progress=False) for name, scene in scenes.items()}
    flexible, *others = runs
    with Turns(runs) as turns:
        for _ in range(options.steps):
            turns.take(flexible)
            for _ in range(PAIRS):
                turns.take(*others)
    rows = []
    for n in options.bodies:
        own, alone = ("chain", n), ("ideal", n) if layers[n] else None
        last = turns.reports[own][-1]
        share = 1 - sum(body.cells for body in last.bodies) / (along * across**2)
        per_iteration = turns.ratio(own, flexible, per_iteration=True)
        rows.append(
            {
                "bodies": n,
                "flexible_cells": share,
                "unknowns": last.unknowns,
                "ratio_to_flexible": turns.ratio(own, flexible),
                "ratio_to_ideal": turns.ratio(own, alone, per_iteration=True) if alone else None,
                "ideal_to_flexible": turns.ratio(alone, flexible, True) if alone else None,
                "ratio_to_cells": per_iteration / share if share else None,
                "newton_per_step": turns.newton(own),
                "seconds_per_step": turns.median(own),
                "solver": last.solver,
            }
        )
        # Condensing must not cost iterations with new tangents, or it is not exact.
        assert iterations(scenes[own]) <= iterations(scenes[flexible]) + 1, rows[-1]
    last = turns.reports[flexible][-1]
    return {
        "unknowns": last.unknowns,
        "flexible_seconds_per_step": turns.median(flexible),
        "flexible_newton_per_step": turns.newton(flexible),
        "chains": rows,
    }


def switches(options: Namespace) -> dict[str, Any]:
    """Observation, the first step, freezes and releases, in plain steps."""

    def begun() -> tuple[rf.Scene, Any]:
        along, across = cells_of_bar(options.unknowns)
        flexible = along - max(1, along // 10)
        domain = bar(along, across).with_cells("end", lambda x: x[0] >= flexible - 1e-9)
        scene = rf.Scene(domain, MATERIAL, [PUSH])
        reports = rf.simulate(scene, DT, 1e6, progress=False)
        next(reports)
        next(reports)
        return scene, reports

    begun()[1].close()  # compiles
    first, (scene, plain) = timed(begun)
    nothing = rf.StrainRate(0.0, WINDOW * DT)
    observed = rf.simulate(scene, DT, 1e6, rigidify=nothing, progress=False)
    with Turns({"plain": plain, "observed": observed}, warm=2) as turns:
        for _ in range(max(options.steps, 2 * WINDOW)):
            turns.take()
    usual = turns.median("plain")
    releases = rf.Release(at=[(2 * k + 2) * WINDOW * DT for k in range(3)])
    everything = rf.StrainRate(1e9, WINDOW * DT, never="end", patience=1, release=releases)
    taken: dict[str, list[float]] = {"freeze": [], "release": []}
    end = 6.5 * WINDOW * DT
    for report in rf.simulate(scene, DT, end, rigidify=everything, progress=False):
        for event in report.events[:1]:
            # Of a freeze the step before it is part of the time, of a release it is not.
            taken[event.kind].append(report.wall - (usual if event.kind == "freeze" else 0.0))
    assert sum(map(len, taken.values())) >= 4, taken
    return {
        "observed_to_plain": turns.ratio("observed", "plain"),
        "first_report_in_steps": first / usual,
        "freeze_in_steps": median(taken["freeze"]) / usual,
        "release_in_steps": median(taken["release"]) / usual,
    }


PARTS = {part.__name__: part for part in (chains, switches)}


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], short="500 unknowns, few steps")
    parser.add_argument("--unknowns", type=int, default=27_000, help="of the flexible bar")
    parser.add_argument("--along", type=int, help="cells along the bar, in place of --unknowns")
    parser.add_argument("--across", type=int, help="cells across it")
    parser.add_argument("--rigid", type=float, default=0.9, help="part of the cells, 0 … 1")
    parser.add_argument("--bodies", type=int, nargs="+", default=[1])
    parser.add_argument("--steps", type=int, default=9, help="timed steps of the flexible bar")
    parser.add_only("parts")
    options = parser.read(unknowns=500, bodies=[1, 3], steps=3)
    run_parts(options, PARTS)

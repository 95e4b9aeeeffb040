"""What each rule of the step's solver buys: iterations and new tangents of a step without it.

Scenes are those of `reduced.py`, flexible and with their parts reduced, the tumbling L, a plate
that bends far, links, steel that falls on its corner, a clamped bar of second-order tetrahedra, and
a bar that turns by 0.8 rad in a step. A tangent counts by its price in iterations
(`rigidfx.step.newton.factors.price`), with four times as many entries in its factors as in itself.
The cost of a step is iterations + price × tangents, alike on every machine. A rule's column has the
cost without it over that with all of them.

    ./fenicsx python3 demos/benchmarks/solver_ablation.py
    ./fenicsx python3 demos/benchmarks/solver_ablation.py --only plate links --rules secants
"""

import warnings
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
from bench import Parser, conclude
from bench.mechanism_scenes import hinged
from budgets import tumbling
from common import say
from reduced import arm, crank, drop, plate, spin

import rigidfx as rf
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton import chord, kept_tangent
from rigidfx.step.newton.factors import entries_of, price
from rigidfx.step.newton.stopping_test import ChordTest
from rigidfx.step.system import system

FILLED = 4.0  # entries of factors over those of a tangent
STEPS = 60  # of each run
STEEL = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7800.0)
Run = tuple[rf.Scene, Any, float]  # scene, Δt and end


def by_case(make: Callable[[], Any], reduced: bool) -> Run:
    """A case of `reduced.py`."""
    case = make()
    return case.scene(*(case.parts if reduced else ())), case.dt, case.t_end


def bent(load: float, *parts: rf.Reduced) -> Run:
    """A steel plate that bends by a third of its length, or less with a reduced half."""
    body = rf.box((0, 0, 0), (0.3, 0.1, 0.003), (30, 10, 1))
    body = body.with_cells("half", lambda x: x[0] >= 0.15 - 1e-9)
    effects = [rf.Fixed("x0"), rf.Traction("x1", (0, 0, load)), *parts]
    return rf.Scene(body, STEEL, effects, element="enhanced"), 5e-4, 0.02


def turning() -> Run:
    """A steel bar that turns by 0.8 rad in a step."""
    body = rf.box((0, 0, 0), (1, 0.1, 0.1), (16, 2, 2))
    return rf.Scene(body, STEEL, [rf.InitialVelocity(angular=(0, 0, 100.0))]), 8e-3, 0.2


def corner() -> Run:
    """A steel block that falls on its corner."""
    body = rf.box((0, 0, 1e-4), (0.1, 0.1, 0.1001), (8, 8, 8))
    floor = rf.Plane((0, 0, 0), (0.02, 0.01, 1))
    contact = rf.Contact("z0", against=floor, stiffness=1e12, title="floor")
    effects = [contact, rf.InitialVelocity((0, 0, -1.0))]
    return rf.Scene(body, STEEL, effects, element="enhanced"), 2e-6, 1.2e-4


def metal() -> Run:
    """A clamped bar of second-order tetrahedra, pushed for half of the 25 steps of its period."""
    body = rf.box((0, 0, 0), (1, 0.2, 0.2), (10, 2, 2), cell="tetrahedron")
    dt = float(1 / (25 * 0.1615 * 0.2 * np.sqrt(STEEL.E / STEEL.rho)))
    push = rf.Traction("x1", (0, 0, 5e6), until=12.5 * dt)  # Pa
    effects = [rf.Fixed("x0"), push]
    return rf.Scene(body, STEEL, effects, order=2, mass="consistent"), dt, 100 * dt


CASES = {"plate": partial(plate, 16), "spin": partial(spin, 38), "drop": partial(drop, 0.02)}
CASES |= {"arm": partial(arm, 0.03), "crank": partial(crank, 0.03)}
SCENES: dict[str, Callable[[], Run]] = {
    **{name: partial(by_case, make, False) for name, make in CASES.items()},
    **{f"{name}, reduced": partial(by_case, make, True) for name, make in CASES.items()},
    "L": lambda: (tumbling(2), 0.1, 6.0),
    "bent": partial(bent, 3e6),
    "bent, reduced": partial(bent, 1e6, rf.Reduced("half")),
    "turning": turning,
    "corner": corner,
    "metal": metal,
    "links": lambda: (hinged(3), 0.02, 1.0),
}
KEPT = "tangents that are kept"  # without it each iteration has a new one
predict = system.predict
RULES: dict[str, tuple[Any, str, Any]] = {  # where each is, and what stands there without it
    "secants": (kept_tangent.Secants, "mend", lambda *_: None),
    "secants, from iterates above rounding alone": (chord, "CLEAR", 0.0),
    "judged after four iterations, not two": (chord, "OWN", 2),
    "guess with relative motion": (system, "predict", lambda *given: predict(*given)[-1:]),
    "guess by mean motion alone": (system, "predict", lambda *given: predict(*given)[:1]),
    "contacts followed by low rank": (kept_tangent.LowRank, "follow", lambda *_: False),
    "rounding is remembered": (ChordTest, "_floor", property(lambda _: 0.0, lambda *_: None)),
}
assemble = Equations.tangent


def cost(make: Callable[[], Run], rule: str | None, steps: int) -> dict[str, Any]:
    """Iterations, tangents and cost of a step, without a rule if one is given."""
    options = {"snes_lag_jacobian": 1} if rule == KEPT else {}
    prices: list[float] = []

    def tangent(equations: Equations) -> None:
        assemble(equations)
        prices.append(price(equations, FILLED * entries_of(equations.tangent_matrix)))

    with ExitStack() as stack:
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore", rf.RigidfxWarning)
        stack.enter_context(patch.object(Equations, "tangent", tangent))
        if rule in RULES:
            stack.enter_context(patch.object(*RULES[rule], create=True))
        scene, dt, t_end = make()
        run = rf.simulate(scene, dt, t_end, petsc_options=options)
        reports = [r for r, _ in zip(run, range(steps + 1), strict=False)]
    n, iterations = len(reports) - 1, sum(report.iterations for report in reports)
    found = {"unknowns": reports[-1].unknowns, "iterations": iterations / n}
    return found | {"tangents": len(prices) / n, "cost": (iterations + sum(prices)) / n}


if __name__ == "__main__":
    parser = Parser(__file__, "What each rule of the solver buys.", "a bar, ten steps")
    parser.add_argument("--only", nargs="+", default=[*SCENES], choices=[*SCENES])
    parser.add_argument("--rules", nargs="*", default=[KEPT, *RULES], choices=[KEPT, *RULES])
    options = parser.read()
    steps, rows = 10 if options.short else STEPS, []
    for name in ["spin", "spin, reduced"] if options.short else options.only:
        row = {"scene": name, **cost(SCENES[name], None, steps)}
        for rule in options.rules:
            row[rule] = cost(SCENES[name], rule, steps)["cost"] / row["cost"]
        rows.append(row)
        say(", ".join(f"{k} {v if k == 'scene' else format(v, '.4g')}" for k, v in row.items()))
    for rule in options.rules:
        ratios = np.array([row[rule] for row in rows])
        mean = float(np.exp(np.log(ratios).mean()))
        say(f"{rule}: {mean:.3f} in the mean, {ratios.min():.3f} to {ratios.max():.3f}")
    conclude(options.out, {"rows": rows})

"""What many rigid bodies cost: a chain of them against the same bar all flexible.

A bar is divided into segments of equal length. Each is one rigid body but for its last two layers
of cells, so that more bodies leave more cells flexible. What a Newton iteration then costs beyond
its flexible cells is told by `ratio_to_cells`: the ratio of times to that of numbers of flexible
cells; 1 would be bodies for nothing. All runs take their steps in turn.

Of the chain with the most bodies the *ideal* runs as well: its flexible cells alone, slabs whose
cuts are held, so that no body's motion has to be found. `ideal_to_flexible` is what these cells
take of the flexible bar's step, at as many iterations as the chain has; `ratio_to_flexible` of the
chain cannot be below that. `chain_to_ideal` is what the bodies add, per iteration.

    ./fenicsx python3 demos/benchmarks/many_bodies.py
"""

from __future__ import annotations

from statistics import median

import numpy as np
from bench import DT, MATERIAL, Parser, Turns, bar, conclude

import rigidfx

ACROSS = 2  # cells
FLEXIBLE = 2  # layers of cells between bodies
IDEAL = -1  # in place of a number of bodies
FORCE = 0.0, 0.02, 0.03  # Pa


def chain(along: int, bodies: int) -> rigidfx.Scene:
    """A bar of so many cells, divided among so many bodies; flexible if none."""
    domain, rigid = bar(along, ACROSS), []
    for k in range(bodies):
        first, last = k * along / bodies, (k + 1) * along / bodies - FLEXIBLE
        domain = domain.with_cells(
            f"body {k + 1}",
            lambda x, first=first, last=last: (x[0] >= first - 1e-9) & (x[0] <= last + 1e-9),
        )
        rigid.append(rigidfx.Rigid(f"body {k + 1}"))
    return rigidfx.Scene(domain, MATERIAL, [rigidfx.Traction("x1", FORCE), *rigid])


def slabs(along: int, bodies: int) -> rigidfx.Scene:
    """The flexible cells of a chain, cut off the bodies and held there; all are pushed sideways."""
    steps = [np.arange(n + 1.0) for n in (FLEXIBLE, ACROSS, ACROSS)]
    x, y, z = (each.reshape(-1) for each in np.meshgrid(*steps, indexing="ij"))
    number = np.arange(x.size).reshape([each.size for each in steps])
    corners = [
        number[i : i + FLEXIBLE, j : j + ACROSS, k : k + ACROSS].reshape(-1)
        for k in (0, 1)
        for j in (0, 1)
        for i in (0, 1)
    ]
    ends = (np.arange(bodies) + 1) * along / bodies
    points = np.concatenate([np.stack([x + end - FLEXIBLE, y, z], axis=1) for end in ends])
    cells = np.concatenate([np.stack(corners, axis=1) + k * x.size for k in range(bodies)])
    cuts = np.r_[ends[:-1], ends - FLEXIBLE]
    domain = rigidfx.from_arrays(points, cells).with_facets("side", lambda x: x[1] >= ACROSS - 1e-9)
    domain = domain.with_facets("cuts", lambda x: np.isclose(x[0][:, None], cuts).any(axis=1))
    push = rigidfx.Traction("side", FORCE)
    return rigidfx.Scene(domain, MATERIAL, [push, rigidfx.Fixed("cuts")])


def main() -> None:
    """Run the comparison and write its summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="two chains, few steps")
    parser.add_argument("--bodies", type=int, nargs="+", default=[1, 2, 5, 10, 20, 40])
    parser.add_argument("--along", type=int, default=160, help="cells along the bar")
    parser.add_argument("--steps", type=int, default=20, help="timed steps")
    options = parser.read(bodies=[1, 5], along=40, steps=3)
    runs = {
        bodies: rigidfx.simulate(chain(options.along, bodies), DT, 1e6, progress=False)
        for bodies in (0, *options.bodies)
    }
    most = max(options.bodies)
    ideal = slabs(options.along, most)
    runs[IDEAL] = rigidfx.simulate(ideal, DT, 1e6, progress=False)
    with Turns(runs) as turns:
        for _ in range(options.steps):
            turns.take()

    def row(bodies: int) -> dict[str, float | int]:
        last = turns.reports[bodies][-1]
        share = 1 - sum(body.cells for body in last.bodies) / (options.along * ACROSS**2)
        ratio = turns.ratio(bodies, 0, per_iteration=True)
        return {
            "bodies": bodies,
            "flexible_cells": share,
            "unknowns": last.unknowns,
            "seconds_per_iteration": median(turns.per_iteration(bodies)),
            "ratio_to_flexible": ratio,
            "ratio_to_cells": ratio / share,
            "newton_per_step": turns.newton(bodies),
        }

    each = turns.ratio(IDEAL, 0, per_iteration=True)
    summary = {
        "chains": [row(bodies) for bodies in runs if bodies != IDEAL],
        "bodies": most,
        "ratio_to_flexible": turns.ratio(most, 0),
        "ideal_to_flexible": each * turns.newton(most) / turns.newton(0),
        "ideal_to_flexible_per_iteration": each,
        "chain_to_ideal": turns.ratio(most, IDEAL, per_iteration=True),
        "ideal_newton_per_step": turns.newton(IDEAL),
        "ideal_unknowns": turns.reports[IDEAL][-1].unknowns,
    }
    conclude(options.out, summary)
    # Condensing must not cost Newton iterations, or it is not exact.
    flexible, *chains = (each["newton_per_step"] for each in summary["chains"])
    assert max(chains) <= flexible + 1


if __name__ == "__main__":
    main()

"""What many rigid bodies cost: a chain of them against the same bar all flexible.

A bar is divided into segments of equal length. Each is one rigid body but for its last two layers
of cells, so that more bodies leave more cells flexible. What a Newton iteration then costs beyond
its flexible cells is told by `ratio_to_cells`: the ratio of times to that of numbers of flexible
cells; 1 would be bodies for nothing. All runs take their steps in turn.

    ./fenicsx python3 demos/benchmarks/many_bodies.py
"""

from __future__ import annotations

from statistics import median

from bench import DT, MATERIAL, Parser, Turns, bar, conclude

import rigidfx

ACROSS = 2  # cells
FLEXIBLE = 2  # layers of cells between bodies
PUSH = rigidfx.Traction("x1", (0.0, 0.02, 0.03))  # Pa


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
    return rigidfx.Scene(domain, MATERIAL, [PUSH, *rigid])


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

    summary = {"chains": [row(bodies) for bodies in runs]}
    conclude(options.out, summary)
    # Condensing must not cost Newton iterations, or it is not exact.
    flexible, *chains = (each["newton_per_step"] for each in summary["chains"])
    assert max(chains) <= flexible + 1


if __name__ == "__main__":
    main()

"""How well conditioned are the equations of a step: rigid body, flexible stiff part, or penalty?

One half of a bar is `ratio` times as stiff as the other. Four ways to treat that half are compared,
for the same motion and the same Δt, by the 2-norm condition number of the tangent of one step:

* *reduced*: the stiff half is a rigid body in minimal coordinates, six unknowns;
* *flexible*: all cells are flexible, with their own E;
* *penalty*: all cells are flexible, and the nodes of the stiff half are tied besides by springs to
  the motion of six extra unknowns: p = 10³ times the largest diagonal entry of the flexible
  tangent, as a tie has to be stiffer than what it ties;
* *penalty, cells left out*: the cells of the stiff half are taken out, its nodes keep their masses,
  and p is 10³ times the largest diagonal entry of what is left.

All matrices are unit-free: rotations are multiplied by the length ℓ, moments divided by it, and
rows and columns scaled symmetrically by the square root of the diagonal (Jacobi), which is what a
Krylov solver with the simplest of preconditioners sees.

What comes out for a bar of 8 × 2 × 2 cells of 1 m and Δt = 0.1 s, in which a wave runs through
three cells of the soft half:

    E stiff / E soft   reduced   flexible   penalty   penalty, cells left out
                   1      15.4       16.3    1.1e+5                    1.1e+5
              10 000      15.4     1.5e+5    8.8e+8                    1.1e+5
         100 000 000      15.4     1.5e+9    8.8e+12                   1.1e+5

So the reduced system does not know how stiff its bodies are, while the flexible one's condition is
proportional to the ratio, once the stiffness outweighs the mass. A penalty multiplies either by
nearly 10⁴: most of it is p, the rest grows with the nodes of the body. Without a difference in
stiffness six unknowns in place of half the dofs gain next to nothing, as the soft half determines
the condition.

    ./fenicsx python3 demos/benchmarks/conditioning.py
"""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path

import numpy as np
from bench import Parser, conclude, write
from bench.tangents import DT, PENALTY, condition, scene, tangent, tied
from mpi4py import MPI

from rigidfx.plot import figure_of, on_first_rank, save

RATIOS = (1.0, 1e4, 1e8)


def compare(ratio: float, short: bool) -> dict[str, float]:
    """Condition numbers of the four treatments."""
    reduced, _ = tangent(scene(ratio, rigid=True, short=short))
    problem = scene(ratio, rigid=False, short=short)
    flexible, x = tangent(problem)
    nodes = problem.nodes("stiff", "benchmark")
    # What is left without the stiff cells: theirs are next to nothing, and masses are lumped.
    bare, _ = tangent(scene(1e-9, rigid=False, short=short))
    return {
        "reduced": condition(reduced),
        "flexible": condition(flexible),
        "penalty": condition(tied(flexible, x, nodes, PENALTY * np.diag(flexible).max())),
        "penalty, cells left out": condition(tied(bare, x, nodes, PENALTY * np.diag(bare).max())),
    }


def draw(rows: dict[float, dict[str, float]], path: Path) -> None:
    """Condition numbers against the ratio of the moduli."""
    figure, axes = figure_of(1, 1, (8.0, 5.0), "Condition of one step's equations")
    ax = axes[0, 0]
    for name, style in zip(next(iter(rows.values())), ("o-", "s-", "^-", "v--"), strict=True):
        ax.loglog(list(rows), [row[name] for row in rows.values()], style, label=name)
    ax.set_xlabel("E of the stiff half / E of the soft half")
    ax.set_ylabel("condition number\n(2-norm, unit-free, Jacobi-scaled)")
    ax.legend()
    save(figure, path)


def main() -> None:
    """Print the table, write summary.json, table.csv and a picture."""
    options = Parser(__file__, __doc__.splitlines()[0], short="4 × 1 × 1 cells").read()
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("dense matrices: run this on one rank")
    rows = {ratio: compare(ratio, options.short) for ratio in RATIOS}
    names = list(rows[RATIOS[0]])
    print(f"{'ratio':>8}" + "".join(f"{name:>26}" for name in names))
    for ratio, row in rows.items():
        print(f"{ratio:8.0e}" + "".join(f"{row[name]:26.3g}" for name in names))
    table = StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["ratio", *names])
    writer.writerows([ratio, *row.values()] for ratio, row in rows.items())
    write(options.out / "table.csv", table.getvalue())
    summary = {
        "dt": DT,
        "penalty_over_largest_diagonal": PENALTY,
        "condition": {f"{ratio:g}": row for ratio, row in rows.items()},
    }
    conclude(options.out, summary)
    picture = options.out / "conditioning.png"
    on_first_rank(MPI.COMM_WORLD, lambda: draw(rows, picture), f"conditioning: '{picture}'")
    reduced = [row["reduced"] for row in rows.values()]
    # The stiffness of a rigid body appears nowhere.
    assert max(reduced) <= min(reduced) * (1 + 1e-6), reduced
    for ratio, row in rows.items():
        assert row["reduced"] <= row["flexible"] * (1 + 1e-6), (ratio, row)
        assert 100 * row["reduced"] < min(row["penalty"], row["penalty, cells left out"]), row


if __name__ == "__main__":
    main()

"""Known problems: numbers that others publish, beside ours.

A row has a quantity of a problem, its source, the published value, ours, the relative error, the
largest error allowed (None where a number is shown without a bound), and the seconds of processors
of the run, set-up, compilers and peers included; flexible, reduced, rigid or with found parts. The
modules in `known/` say all.

    ./fenicsx python3 demos/benchmarks/known_problems.py
    ./fenicsx mpirun -n 2 python3 demos/benchmarks/known_problems.py --out out/two \\
        --beside out/known_problems

The second command checks that two ranks give the same numbers, to 1e-7 or, of reduced parts, 1e-4.
Exudyn is a peer of the four-bar linkages, as `mechanisms.py` says, and CalculiX of the Princeton
beam, on one rank, as `peers.py` says. `summary.json` has the rows, `errors.png` the errors and
their bounds.
"""

import json
import os
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib as mpl
from bench import Parser, chosen, conclude
from common import comm, say
from known import PROBLEMS

import rigidfx as rf

SAME = 1e-7  # largest difference between runs on different ranks, relative
SAME_SHAPES = 1e-4  # that of reduced parts, the last of whose Ritz vectors rest on rounding

LEAST = 1e-8  # error that is drawn at the left edge
MARKS = {"flexible": "o", "reduced": "s", "rigid": "^", "found": "D"}
Row = dict[str, Any]


def seconds() -> float:
    """Those of this process and of its ended children."""
    return sum(os.times()[:4])


def rows_of(name: str, short: bool) -> list[Row]:
    """The numbers of a problem."""
    problem, rows = PROBLEMS[name], []
    began = seconds()
    for found in problem.runs(short):
        spent = seconds() - began
        for one in found:
            row = {"problem": name, "source": problem.source, **asdict(one), "error": one.error}
            rows.append(row | {"seconds": spent, "ranks": comm.size})
            say(f"{name}: {one.quantity}: {one.ours:.6g} for {one.published:.6g}, {one.error:.2e}")
        began = seconds()
    return rows


def beside(rows: list[Row], folder: Path) -> None:
    """Compare with the numbers of another run."""
    others = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    known = {(row["problem"], row["quantity"], row["kind"]): row["ours"] for row in others}
    for row in rows:
        other = known[row["problem"], row["quantity"], row["kind"]]
        row["apart"] = abs(row["ours"] - other) / abs(row["scale"] or row["published"])
    most = {"reduced": SAME_SHAPES}
    other = [row for row in rows if row["apart"] > most.get(row["kind"], SAME)]
    assert not other, other


def draw_errors(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw each number's error against its bound, a line for each problem."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    names = list(dict.fromkeys(row["problem"] for row in rows))[::-1]
    figure, axes = plt.subplots(figsize=(8, 1.2 + 0.3 * len(names)), layout="constrained")
    for kind, mark in MARKS.items():
        own = [row for row in rows if row["kind"] == kind and row["allowed"] is not None]
        x = [max(row["error"], LEAST) for row in own]
        axes.plot(x, [names.index(row["problem"]) for row in own], mark, label=kind, alpha=0.7)
    bounded = [row for row in rows if row["allowed"] is not None]
    places = [names.index(row["problem"]) for row in bounded]
    axes.plot([row["allowed"] for row in bounded], places, "k|", markersize=12, label="bound")
    axes.set(xscale="log", xlabel="relative error", yticks=range(len(names)), yticklabels=names)
    figure.legend(loc="outside upper center", ncols=5, fontsize="small")
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], "coarse meshes, few cases")
    parser.add_only("problems")
    parser.add_argument("--beside", type=Path, help="folder of a run with the same options")
    options = parser.read()
    warnings.simplefilter("ignore", rf.RigidfxWarning)
    rows = [row for name in chosen(options, PROBLEMS) for row in rows_of(name, options.short)]
    rows = comm.bcast(rows)
    if options.beside:
        beside(rows, options.beside)
    if comm.rank == 0:
        options.out.mkdir(parents=True, exist_ok=True)
        draw_errors(rows, options.out / "errors.png")
    conclude(options.out, rows)
    missed = [row for row in rows if row["allowed"] is not None and row["error"] > row["allowed"]]
    assert not missed, missed

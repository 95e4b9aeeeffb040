"""What a step costs from ten thousand unknowns to a million: time, memory and how they grow.

A soft body, the tumbling L of first-order hexahedra, and a clamped bar of steel, of second-order
tetrahedra and 25 steps to the first period; all flexible, or most of it one compact rigid body.
Under mpirun all ranks share each size.

    ./fenicsx python3 demos/benchmarks/scaling.py --unknowns 10000 100000 1000000
    ./fenicsx mpirun -n 2 python3 demos/benchmarks/scaling.py --case metal --rigid --redistribute
    ./fenicsx mpirun -n 2 python3 demos/benchmarks/scaling.py --speedup --unknowns 200000
    ./fenicsx mpirun -n 2 python3 demos/benchmarks/scaling.py --dealt --unknowns 200000

`cost_exponent` is the slope of log(seconds per step), medians, over log(unknowns), from 10 000 on.
Δt stays the same, so that in finer meshes waves pass more cells in a step; with `--same-waves` it
shrinks with the cells, as waves themselves need it. What a mean step is made of has slopes of its
own, over all sizes and from each to the next one (`exponents`): iterations of Newton's method and
of linear solvers, and what one of each takes for an unknown of the step, in linear systems and
in all the rest, tangents among it (`ns_per_linear_iteration`, `ns_per_newton_iteration`). Where
matrix and factors leave the cache, the former grows. `memory` is the largest so far of the
processes together, so sizes should ascend. `setup` is from the mesh to the report of the first
step, importing and compiling apart: the smallest mesh runs first. Unknowns are those of the
flexible structure, also where most of it is rigid.

`--speedup` has steps of all ranks, of one of them, and what tells how much faster all of them could
be at most, in turn: independent runs of a rank's share of the unknowns, one alone and one on each
rank at the same time (`ceiling`), and what memory gives one core and all (`ceiling_by_bandwidth`),
see `bench.ceiling`.

`--dealt` has the same with nine tenths rigid: with the flexible cells dealt out among the ranks,
left where the mesh has them, after `rigidfx.redistribute`, and on one of the ranks alone.
`dealt_over` are medians of ratios; `seconds_to_deal` come with a change of bodies, and in place of
them `seconds_to_keep` where what has been dealt serves for the next division.
"""

from __future__ import annotations

import resource
from collections.abc import Callable
from contextlib import closing
from functools import partial
from itertools import pairwise
from statistics import mean, median
from typing import Any

import numpy as np
from bench import Parser, conclude, timed
from bench.ceiling import started, with_ceiling
from bench.dealt import in_turn
from common import comm, say
from flexible_step import TRACTION
from mpi4py import MPI
from petsc4py import PETSc

import rigidfx as rf
from meshes.tumbling_l import tumbling_l

RUBBER = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)  # Pa, 1, kg/m³
STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
BAR = (1.0, 0.2, 0.2)  # m
PERIOD = 1 / (0.1615 * BAR[2] / BAR[0] ** 2 * np.sqrt(STEEL.E / STEEL.rho))  # s, a slender beam's
PER_PERIOD = 25  # steps
DT = 0.05  # s, of the L
MADE_OF = "newton", "linear_iterations", "ns_per_newton_iteration", "ns_per_linear_iteration"
SMALL = 9000  # unknowns; fewer do not tell how cost grows


def soft(
    refine: int, rigid: bool, redistribute: bool, ranks: MPI.Intracomm = comm
) -> tuple[rf.Scene, float]:
    """The L with cells of edge 1/refine, and Δt [s]; rigid but for its upper tenth."""
    domain = tumbling_l(refine, comm=ranks).with_cells("rigid", lambda x: x[1] <= 8.7 + 1e-9)
    domain = rf.redistribute(domain, ["rigid"]) if redistribute else domain
    loads = {"top": TRACTION, "side": -TRACTION}
    effects: list[rf.Effect] = [rf.Traction(name, tuple(t)) for name, t in loads.items()]
    return rf.Scene(domain, RUBBER, effects + [rf.Rigid("rigid")] * rigid), DT


def metal(
    across: int, rigid: bool, redistribute: bool, ranks: MPI.Intracomm = comm
) -> tuple[rf.Scene, float]:
    """The bar with so many cells across, and Δt [s]; rigid but for the tenth at its support."""
    cells = (5 * across, across, across)
    domain = rf.box((0, 0, 0), BAR, cells, cell="tetrahedron", comm=ranks)
    domain = domain.with_cells("rigid", lambda x: x[0] >= 0.1 * BAR[0] - 1e-9)
    domain = rf.redistribute(domain, ["rigid"]) if redistribute else domain
    push = rf.Traction("x1", (0.0, 0.0, 1e6))
    scene = rf.Scene(
        domain,
        STEEL,
        [rf.Fixed("x0"), push, *[rf.Rigid("rigid")] * rigid],
        order=2,
        mass="consistent",
    )
    return scene, PERIOD / PER_PERIOD


# Unknowns by the number that says how fine the mesh is.
COUNT: dict[str, Callable[[int], int]] = {
    "soft": lambda r: 3 * (3 * r + 1) * ((6 * r + 1) * (3 * r + 1) + 7 * r * (3 * r + 1)),
    "metal": lambda n: 3 * (10 * n) * (2 * n + 1) ** 2,
}
SCENES = {"soft": soft, "metal": metal}
OF_TEN_THOUSAND = {"soft": 3, "metal": 4}  # fineness


def measure(
    case: str, fineness: int, rigid: bool, redistribute: bool, steps: int, same_waves: bool
) -> dict[str, object]:
    """One size."""

    def begin() -> tuple[rf.Scene, float]:
        return SCENES[case](fineness, rigid, redistribute)

    building, (scene, dt) = timed(begin)
    dt *= OF_TEN_THOUSAND[case] / fineness if same_waves else 1.0
    preparing, run = timed(lambda: rf.simulate(scene, dt, 1e6 * dt, progress=False))
    with closing(run) as reports:
        beginning, _ = timed(lambda: next(reports))
        first, report = timed(lambda: next(reports))
        seconds, taken = [], []
        solving = -_in_solves()
        for _ in range(steps):
            each, report = timed(lambda: next(reports))
            seconds.append(each)
            taken.append(report)
        solving += _in_solves()
    newton = mean(each.iterations for each in taken)
    linear = mean(each.linear_iterations for each in taken)
    ns = 1e9 / report.unknowns
    peak = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    return {
        "unknowns": COUNT[case](fineness),
        "unknowns_of_a_step": report.unknowns,
        "setup": building + preparing + beginning + first,
        "first_step": first,
        "seconds_per_step": median(seconds),
        "mean_seconds_per_step": mean(seconds),
        "newton": newton,
        "tangents": mean(each.tangents for each in taken),
        "linear_iterations": linear,
        "ns_per_newton_iteration": ns * (sum(seconds) - solving) / steps / newton,
        "ns_per_linear_iteration": ns * solving / steps / linear,
        "solver": report.solver,
        "memory": peak / 1e9,
    }


def _in_solves() -> float:
    """Time in which linear systems have been solved so far, once PETSc counts [s]."""
    return float(PETSc.Log.Event("KSPSolve").getPerfInfo()["time"])


def slopes(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Slopes of logarithms over that of the unknowns, of a mean step and of what it is made of."""
    x = np.log([row["unknowns"] for row in rows])
    return {
        name: float(np.polyfit(x, np.log([row[name] for row in rows]), 1)[0])
        for name in ("mean_seconds_per_step", *MADE_OF)
    }


def of_all_ranks(
    case: str, fineness: int, share: int, rigid: bool, steps: int
) -> dict[str, object]:
    """How much faster all ranks are than one, and how much they could be."""
    scene = SCENES[case]
    run = started(*scene(fineness, rigid, rigid))
    _, told = with_ceiling(
        {"all ranks": run},
        lambda: scene(fineness, rigid, False, MPI.COMM_SELF),
        lambda: scene(share, rigid, False, MPI.COMM_SELF),
        steps,
    )
    run.close()  # type: ignore[attr-defined]
    return {"rigid": rigid, "unknowns": COUNT[case](fineness), **told}


def main() -> None:
    """Run all sizes and write their summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="up to 10 000 unknowns")
    parser.add_argument("--case", choices=list(SCENES), default="soft")
    parser.add_argument("--rigid", action="store_true", help="nine tenths are one rigid body")
    parser.add_argument(
        "--redistribute", action="store_true", help="rigid and flexible cells divided alike"
    )
    parser.add_argument(
        "--dealt", action="store_true", help="under mpirun, of the first size: cells dealt or not"
    )
    parser.add_argument(
        "--speedup", action="store_true", help="under mpirun, of the first size: what ranks gain"
    )
    parser.add_argument("--same-waves", action="store_true", help="Δt shrinks with the cells")
    sizes = [10_000, 30_000, 100_000, 300_000, 1_000_000]
    parser.add_argument("--unknowns", type=int, nargs="+", default=sizes, help="about so many")
    parser.add_argument("--steps", type=int, default=5, help="timed steps of each")
    options = parser.read(unknowns=[700, 3000, 10_000], steps=3)

    def fine(unknowns: float) -> int:
        return min(range(1, 60), key=lambda n: abs(COUNT[options.case](n) - unknowns))

    fineness = [fine(wanted) for wanted in sorted(options.unknowns)]
    share = fine(COUNT[options.case](fineness[0]) / comm.size)
    chosen = options.rigid, options.redistribute
    PETSc.Log.begin()
    measure(options.case, 1, *chosen, 1, options.same_waves)  # compiles
    if options.dealt:
        made = partial(SCENES[options.case], fineness[0], True)
        shared = partial(SCENES[options.case], share, True, False, MPI.COMM_SELF)
        conclude(options.out, {"case": options.case, **in_turn(made, shared, options.steps)})
        return
    if options.speedup:
        told = of_all_ranks(options.case, fineness[0], share, options.rigid, options.steps)
        conclude(options.out, {"case": options.case, **told})
        return
    rows = []
    for n in fineness:
        rows.append(measure(options.case, n, *chosen, options.steps, options.same_waves))
        say(str(rows[-1]))
    large = [row for row in rows if row["unknowns"] >= SMALL] or rows
    exponents = {"all": slopes(large)} if len(large) > 1 else {}
    for pair in pairwise(large):
        exponents[" to ".join(str(row["unknowns"]) for row in pair)] = slopes(list(pair))
    x, y = (np.log([row[key] for row in large]) for key in ("unknowns", "seconds_per_step"))
    conclude(
        options.out,
        {
            "case": options.case,
            "rigid": options.rigid,
            "redistributed": options.redistribute,
            "same_waves": options.same_waves,
            "ranks": comm.size,
            "cost_exponent": float(np.polyfit(x, y, 1)[0]) if exponents else None,
            "exponents": exponents,
            "memory_per_million_unknowns": rows[-1]["memory"] / rows[-1]["unknowns"] * 1e6,
            "sizes": rows,
        },
    )


if __name__ == "__main__":
    main()

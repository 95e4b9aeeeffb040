"""Flexible steps: seconds, memory and growth by size, beside a plain loop of DOLFINx, and on ranks.

* *sizes*: a cantilever of 4×1×1 of rubber, through which waves pass three edges in a step, and one
  of steel at 40 steps to its first period; and a tumbling L of first-order hexahedra, flexible or
  nine tenths rigid. `prepared_s` is the time from the mesh to the end of the first step, with forms
  compiled before; `cost_exponent` the slope of log(seconds per step) over log(unknowns) from 10 000
  on. On one rank each run is a process of its own, so that its peak of memory is its own.
* *plain*: steps of the L in turn with a loop that a user of DOLFINx would write: the same scheme,
  quadrature, lumped mass, first guess and stopping test, but one form with the inertia in it,
  default compiler options, an AIJ matrix, an SNES. With the same linear solvers on both sides
  (`ratio_to_plain_dolfinx`), and with the best of each side (`ratio_best_to_best`).
* *ranks*, under mpirun: steps of all ranks beside one rank, and beside independent runs of a rank's
  share of the unknowns, one alone and one on each rank at the same time. Memory is shared: n ranks
  gain n · alone/together at most (`ceiling`).

    ./fenicsx python3 demos/benchmarks/speed.py --unknowns 3000 10000 30000
    ./fenicsx python3 demos/benchmarks/speed.py --only sizes --cases L --unknowns 100000 1000000
    ./fenicsx mpirun -n 2 python3 demos/benchmarks/speed.py --only ranks --cases L --unknowns 200000
"""

from argparse import Namespace
from collections.abc import Iterator
from resource import RUSAGE_SELF, getrusage
from statistics import mean, median
from time import sleep
from typing import Any

import numpy as np
from bench import ENDS, Parser, Turns, alone, pushed_l, run_parts, timed
from bench.plain import LU_BELOW, SOLVERS, PlainLoop
from common import comm, say
from mpi4py import MPI

import rigidfx as rf
from meshes.tumbling_l import tumbling_l

METALS = {
    "rubber": rf.StVenantKirchhoff(E=1e6, nu=0.45, rho=1100.0),  # Pa, 1, kg/m³
    "steel": rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0),
}
ELEMENTS = {  # kind and order of cells, mass, element
    "hexahedra": ("hexahedron", 1, "lumped", "enhanced"),
    "second-order hexahedra": ("hexahedron", 2, "lumped", "standard"),
    "second-order tetrahedra": ("tetrahedron", 2, "consistent", "standard"),
}
L, RIGID_L = "L", "L, nine tenths rigid"
CASES = [*(f"{metal}, {kind}" for kind in ELEMENTS for metal in METALS), L, RIGID_L]
SHORT = "steel, hexahedra"
LENGTH, EDGE = 0.4, 0.1  # m, of the cantilever
SOFT_EDGES = 3  # between nodes, that waves pass in a step
WARM = 4  # steps before the first that is timed
SMALL = 9000  # unknowns; fewer do not show how cost grows
DT = 0.1  # s, of the L
OURS = {"gmres+ilu": {"snes_ksp_ew": "0", **SOLVERS["gmres+ilu"]}}  # GMRES ends at rtol


def tumbling(unknowns: int, rigid: bool = False, order: int = 1, ranks: Any = comm) -> rf.Scene:
    """The L with about so many unknowns under a constant pair of tractions."""

    def count(refine: int) -> int:
        r = order * refine
        return 3 * (3 * r + 1) * ((6 * r + 1) * (3 * r + 1) + 7 * r * (3 * r + 1))

    refine = min(range(1, 25), key=lambda r: abs(count(r) - unknowns))
    domain = tumbling_l(refine, comm=ranks).with_cells("rigid", lambda x: x[1] <= 8.7 + 1e-9)
    return pushed_l(domain, *[rf.Rigid("rigid")] * rigid, order=order)


def scene_and_step(case: str, unknowns: int, ranks: Any = comm) -> tuple[rf.Scene, float]:
    """A case with about so many unknowns, and Δt [s]."""
    if case in (L, RIGID_L):
        return tumbling(unknowns, case == RIGID_L, ranks=ranks), DT / 2
    metal, element = case.split(", ")
    cell, order, mass, kind = ELEMENTS[element]
    across = max(1, round(((unknowns / 12) ** (1 / 3) - 0.75) / order))  # cells
    box = rf.box((0, 0, 0), (LENGTH, EDGE, EDGE), (4 * across, across, across), cell, comm=ranks)
    law = METALS[metal]
    push = rf.Traction("x1", (0, 0, 2e-5 * law.E))
    scene = rf.Scene(box, law, [rf.Fixed("x0"), push], order=order, mass=mass, element=kind)
    wave = np.sqrt(law.E * (1 - law.nu) / ((1 + law.nu) * (1 - 2 * law.nu)) / law.rho)
    period = LENGTH**2 / (0.1615 * EDGE) / np.sqrt(law.E / law.rho)
    return scene, SOFT_EDGES * EDGE / (across * order) / wave if metal == "rubber" else period / 40


def started(scene: rf.Scene, dt: float) -> Iterator[rf.Report]:
    """A run after its first step."""
    reports = rf.simulate(scene, dt, 1e6 * dt, progress=False)
    next(reports)
    next(reports)
    return reports


def measure(case: str, unknowns: int, steps: int) -> dict[str, Any]:
    """Times and memory of one run."""
    started(*scene_and_step(case, 1))  # compiles
    prepared, reports = timed(lambda: started(*scene_and_step(case, unknowns)))
    for _ in range(WARM):
        next(reports)
    rows = [timed(lambda: next(reports)) for _ in range(steps)]
    return {
        "case": case,
        "unknowns": rows[-1][1].unknowns,
        "step_s": median(time for time, _ in rows),
        "iterations": mean(report.iterations for _, report in rows),
        "linear_iterations": mean(report.linear_iterations for _, report in rows),
        "tangents": mean(report.tangents for _, report in rows),
        "prepared_s": prepared,
        "memory_MB": getrusage(RUSAGE_SELF).ru_maxrss / 1024,
        "solver": rows[-1][1].solver,
    }


def sizes(options: Namespace) -> dict[str, Any]:
    """All cases and sizes."""
    rows: list[dict[str, Any]] = []
    exponents = {}
    for case in options.cases:
        for unknowns in options.unknowns:
            if options.short or comm.size > 1:
                rows.append(measure(case, unknowns, options.steps))
            else:
                rows.append(alone(measure, case, unknowns, options.steps))
            say(str(rows[-1]))
        large = [r for r in rows if r["case"] == case and r["unknowns"] >= SMALL]
        if len(large) > 1:
            x, y = (np.log([row[key] for row in large]) for key in ("unknowns", "step_s"))
            exponents[case] = float(np.polyfit(x, y, 1)[0])
    return {"runs": rows, "cost_exponent": exponents}


def compare(
    problem: rf.Scene, ours: dict[str, str], plain: dict[str, str], steps: int
) -> dict[str, Any]:
    """Steps of rigidfx and of the plain loop in turn; both find the same motion."""
    reports = rf.simulate(problem, DT, 1e6, progress=False, petsc_options=ours)
    next(reports)
    first = next(reports)
    tractions = {end: lambda t, load=load: load for end, load in ENDS.items()}
    loop = PlainLoop(problem, DT, tractions, plain, floor=2 * first.residuals[-1])
    next(loop)  # as far as rigidfx is
    with Turns({"rigidfx": reports, "plain": loop}, warm=0) as turns:
        for _ in range(steps):
            turns.take()
        both = turns.reports["rigidfx"], turns.reports["plain"]
        here = both[0][-1].state.u.x.array
        difference = float(np.abs(here - loop.u0.x.array).max() / np.abs(here).max())
    # They solve the same equations to Newton's tolerance, or the comparison means nothing.
    assert difference < 1e-9, difference
    return {
        "ratio": turns.ratio("rigidfx", "plain"),
        "rigidfx_s": turns.median("rigidfx"),
        "plain_s": turns.median("plain"),
        "newton": [sum(step.iterations for step in run) for run in both],
        "linear": [sum(step.linear_iterations for step in run) for run in both],
        "solver": both[0][-1].solver,
        "difference": difference,
    }


def plain(options: Namespace) -> dict[str, Any]:
    """The L of one size by both loops."""
    problem = tumbling(options.unknowns[-1], order=options.order)
    unknowns = 3 * problem.space.dofmap.index_map.size_global
    solvers = [name for name in SOLVERS if name != "lu" or unknowns < LU_BELOW]
    same = {
        name: compare(problem, OURS.get(name, SOLVERS[name]), SOLVERS[name], options.steps)
        for name in solvers
    }
    plain_best = min(solvers, key=lambda name: same[name]["plain_s"])
    best = compare(problem, {}, SOLVERS[plain_best], options.steps)
    return {
        "ratio_to_plain_dolfinx": same["gmres+ilu"]["ratio"],
        "ratio_best_to_best": best["ratio"],
        "plain_unknowns": unknowns,
        "same_solver": same,
        "best": best,
        "plain_best_solver": plain_best,
    }


def meet() -> None:
    """Wait for all ranks, without keeping a core busy while others are timed. Collective."""
    request = comm.Ibarrier()
    while not request.Test():
        sleep(1e-3)


def ranks(options: Namespace) -> dict[str, Any]:
    """Steps of all ranks, of one, and of independent shares, in turn."""
    if comm.size == 1:
        return {}
    [case], n, one = options.cases, options.unknowns[-1], comm.rank == 0

    def by_itself(unknowns: int) -> Iterator[rf.Report]:
        return started(*scene_and_step(case, unknowns, MPI.COMM_SELF))

    runs: dict[str, Iterator[rf.Report] | None] = {
        "all": started(*scene_and_step(case, n)),
        "one": by_itself(n) if one else None,
        "share alone": by_itself(n // comm.size) if one else None,
        "shares together": by_itself(n // comm.size),
    }
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(options.steps):
        for name, run in runs.items():
            meet()
            taken, _ = timed(lambda run=run: next(run) if run else None)
            meet()
            seconds[name].append(comm.allreduce(taken, op=MPI.MAX))
    usual = {name: median(times[1:] or times) for name, times in seconds.items()}
    found = {
        "ranks": comm.size,
        "seconds": usual,
        "speedup": usual["one"] / usual["all"],
        "ceiling": comm.size * usual["share alone"] / usual["shares together"],
    }
    say(str(found))
    return found


PARTS = {part.__name__: part for part in (sizes, plain, ranks)}


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], short="700 unknowns, three steps")
    parser.add_argument("--unknowns", type=int, nargs="+", default=[3000, 10_000, 30_000])
    parser.add_argument("--steps", type=int, default=8, help="timed steps of each run")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES, help="of sizes, ranks")
    parser.add_argument("--order", type=int, default=1, choices=(1, 2), help="of plain")
    parser.add_only("parts")
    options = parser.read(unknowns=[700], steps=3, cases=[SHORT])
    run_parts(options, PARTS)

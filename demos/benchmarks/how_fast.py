"""How long a flexible step takes, how long what comes before it, and how much memory a run has.

A cantilever of 4×1×1 is pushed at its end: one of rubber, through which waves pass three edges in a
step, and one of steel at 40 steps to the period of its first bending motion, where they pass
many more. Each run is a process of its own, so that its peak of memory is its own.

    ./fenicsx python3 demos/benchmarks/how_fast.py --unknowns 3000 10000 30000

`step_s` is the median of the steps' wall times, `tangents` the mean number of new ones in a step,
`prepared_s` the time from the mesh to the end of the first step, with forms compiled before.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from resource import RUSAGE_SELF, getrusage
from statistics import mean, median

import numpy as np
from bench import Parser, conclude, timed

import rigidfx as rf

MATERIALS = {
    "rubber": rf.StVenantKirchhoff(E=1e6, nu=0.45, rho=1100.0),  # Pa, 1, kg/m³
    "steel": rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0),
}
LENGTH, EDGE = 0.4, 0.1  # m
ELEMENTS = {  # kind and order of cells, mass, element
    "hexahedra": ("hexahedron", 1, "lumped", "enhanced"),
    "second-order hexahedra": ("hexahedron", 2, "lumped", "standard"),
    "second-order tetrahedra": ("tetrahedron", 2, "consistent", "standard"),
}
SOFT_EDGES = 3  # between nodes, that waves pass in a step
WARM = 4  # steps before the first that is timed


def scene_and_step(element: str, material: str, unknowns: int) -> tuple[rf.Scene, float, float]:
    """A cantilever of about as many unknowns, Δt [s], and how many edges waves pass in it."""
    cell, order, mass, kind = ELEMENTS[element]
    across = max(1, round(((unknowns / 12) ** (1 / 3) - 0.75) / order))  # cells
    box = rf.box((0, 0, 0), (LENGTH, EDGE, EDGE), (4 * across, across, across), cell)
    law = MATERIALS[material]
    push = rf.Traction("x1", (0, 0, 2e-5 * law.E))
    scene = rf.Scene(box, law, [rf.Fixed("x0"), push], order=order, mass=mass, element=kind)
    wave = np.sqrt(law.E * (1 - law.nu) / ((1 + law.nu) * (1 - 2 * law.nu)) / law.rho)
    edge = EDGE / (across * order)
    period = LENGTH**2 / (0.1615 * EDGE) / np.sqrt(law.E / law.rho)
    dt = SOFT_EDGES * edge / wave if material == "rubber" else period / 40
    return scene, dt, wave * dt / edge


def measure(element: str, material: str, unknowns: int, steps: int) -> dict[str, object]:
    """One run's times and memory."""
    _first_report(*scene_and_step(element, material, 1))  # compiles
    prepared, (passed, reports) = timed(
        lambda: _first_report(*scene_and_step(element, material, unknowns))
    )
    for _ in range(WARM):
        next(reports)
    rows = [timed(lambda: next(reports)) for _ in range(steps)]
    return {
        "element": element,
        "material": material,
        "unknowns": rows[-1][1].unknowns,
        "edges_passed": passed,
        "step_s": median(time for time, _ in rows),
        "iterations": mean(report.iterations for _, report in rows),
        "tangents": mean(report.tangents for _, report in rows),
        "prepared_s": prepared,
        "memory_MB": getrusage(RUSAGE_SELF).ru_maxrss / 1024,
        "solver": rows[-1][1].solver,
    }


def _first_report(scene: rf.Scene, dt: float, passed: float) -> tuple[float, Iterator[rf.Report]]:
    """A run after its first step."""
    reports = rf.simulate(scene, dt, 1e6 * dt, progress=False)
    next(reports)
    next(reports)
    return passed, reports


def main() -> None:
    """Measure all, and write the summary."""
    parser = Parser(__file__, __doc__.splitlines()[0], short="300 unknowns, three steps")
    parser.add_argument("--unknowns", type=int, nargs="+", default=[3000, 10_000, 30_000])
    parser.add_argument("--steps", type=int, default=8, help="timed steps of each run")
    parser.add_argument("--elements", nargs="+", choices=ELEMENTS, default=list(ELEMENTS))
    parser.add_argument("--materials", nargs="+", choices=MATERIALS, default=list(MATERIALS))
    options = parser.read(unknowns=[300], steps=3)
    cases = [
        (element, material, unknowns, options.steps)
        for unknowns in options.unknowns
        for material in options.materials
        for element in options.elements
    ]
    for name in [name for name in os.environ if name.startswith("PMI_")]:
        del os.environ[name]  # mpirun of MPICH, if it has started this, knows of no other process
    runs = []
    for case in cases:
        with ProcessPoolExecutor(1, get_context("spawn")) as alone:
            runs.append(alone.submit(measure, *case).result())
        row = runs[-1]
        print(
            f"{row['material']:7s}{row['element']:25s}{row['unknowns']:7d} unknowns: "
            f"{row['step_s']:8.4f} s a step, {row['iterations']:4.1f} iterations, "
            f"{row['tangents']:4.1f} tangents, first {row['prepared_s']:6.2f} s, "
            f"{row['memory_MB']:5.0f} MB, {row['solver']}, waves pass "
            f"{row['edges_passed']:.0f} edges",
            flush=True,
        )
    conclude(options.out, {"runs": runs})


if __name__ == "__main__":
    main()

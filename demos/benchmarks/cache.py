"""What the cache has to do with how the cost of a step grows: products and solves, warm and cold.

A step of a large soft body is spent in products with its matrix and in solves with incomplete
factors. A small matrix and its factors stay in the cache from one iteration to the next, a large
one comes from memory each time, so an unknown of a large system costs more than one of a small one
however well iterations scale. For each size this takes one matrix over and over (`warm_ns`, for an
unknown), and copies in rotation that together are larger than the cache (`cold_ns`), in turn. The
slopes of their logarithms over that of the unknowns are `warm_exponent` and `cold_exponent`.

The matrix is that of elasticity and mass on the tumbling L, assembled by DOLFINx, in blocks of
three as rigidfx has it.

    ./fenicsx python3 demos/benchmarks/cache.py
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median

import numpy as np
import ufl
from bench import Parser, conclude, timed
from dolfinx import fem
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

import rigidfx as rf
from meshes.tumbling_l import tumbling_l

TOGETHER = 220e6  # bytes of all copies: more than caches hold
ENTRY, COLUMN = 8, 4  # bytes
TURNS = 3
CALLS = 3e6  # unknowns that are gone through in a turn
LEAST = 20  # calls of a turn


def matrix(refine: int) -> PETSc.Mat:
    """Stiffness and mass of the L with cells of edge 1/refine, in blocks of three."""
    space = rf.Scene(tumbling_l(refine), rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)).space
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    a = (ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) + ufl.inner(u, v)) * ufl.dx
    A = petsc.assemble_matrix(fem.form(a))
    A.assemble()
    return A.convert("baij")


def iteration(A: PETSc.Mat) -> Callable[[], None]:
    """A product with a matrix of its own and a solve with its incomplete factors, as a call."""
    B = A.duplicate(copy=True)
    factors = PETSc.PC().create(B.comm)
    factors.setType("ilu")
    factors.setFactorOrdering("rcm")
    factors.setOperators(B)
    factors.setUp()
    x, y = B.createVecs()
    x.set(1.0)

    def call() -> None:
        B.mult(x, y)
        factors.apply(y, x)
        x.set(1.0)

    return call


def measure(refine: int, together: float) -> dict[str, float | int]:
    """Warm and cold calls of one size in turn, the cold ones on copies of so many bytes."""
    A = matrix(refine)
    n, entries = A.getSize()[0], A.getInfo()["nz_used"]
    of_each = 2 * entries * (ENTRY + COLUMN / 9)  # matrix and factors
    calls = [iteration(A) for _ in range(2 + int(together / of_each))]
    every = max(LEAST, int(CALLS / n))
    warm, cold = [], []
    for _ in range(TURNS):
        calls[0]()
        warm += [timed(calls[0])[0] for _ in range(every)]
        for call in calls:
            call()
        cold += [timed(calls[k % len(calls)])[0] for k in range(every)]
    return {
        "unknowns": n,
        "megabytes": of_each / 1e6,
        "copies": len(calls),
        "warm_ns": 1e9 * median(warm) / n,
        "cold_ns": 1e9 * median(cold) / n,
    }


def main() -> None:
    """Measure all sizes and write the summary."""
    options = Parser(
        __file__, __doc__.splitlines()[0], short="up to 4000 unknowns, in a tenth of the memory"
    ).read()
    if MPI.COMM_WORLD.size > 1:
        raise SystemExit("caches of one core: run this on one rank")
    rows = []
    for refine in (1, 2) if options.short else (3, 4, 5, 6, 7, 8):
        rows.append(measure(refine, TOGETHER / 10 if options.short else TOGETHER))
        print(rows[-1], flush=True)
    x = np.log([row["unknowns"] for row in rows])
    told = {
        f"{kind}_exponent": float(np.polyfit(x, np.log([row[f"{kind}_ns"] for row in rows]), 1)[0])
        for kind in ("warm", "cold")
    }
    print(told)
    conclude(options.out, {**told, "sizes": rows})
    assert all(row["cold_ns"] > 0.8 * row["warm_ns"] for row in rows), "what is cold is faster"


if __name__ == "__main__":
    main()

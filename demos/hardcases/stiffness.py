"""A stiff half of a bar: as a rigid body, as a flexible part, or tied by a penalty.

The matrices are those of `demos/benchmarks/conditioning.py`: one step's tangent, unit-free.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from benchmarks.bench.tangents import DT, PENALTY, condition, scene, tangent, tied
from mpi4py import MPI
from petsc4py import PETSc

import rigidfx as rf

__all__ = ["compare"]

RATIO = 1e8  # E of the stiff half over E of the soft one
MOST = 2000  # Krylov iterations


def krylov(A: np.ndarray) -> int | None:
    """Iterations of GMRES with ILU(0) for a random right-hand side, to 1e-8; None if it fails."""
    scale = 1 / np.sqrt(np.abs(np.diag(A)))
    A = scale[:, None] * A * scale
    rows, columns = np.nonzero(A)
    offsets = np.searchsorted(rows, np.arange(len(A) + 1)).astype(np.int32)
    csr = offsets, columns.astype(np.int32), A[rows, columns]
    matrix = PETSc.Mat().createAIJ(A.shape, csr=csr, comm=MPI.COMM_SELF)
    ksp = PETSc.KSP().create(MPI.COMM_SELF)
    ksp.setType(PETSc.KSP.Type.GMRES)
    ksp.setGMRESRestart(100)
    ksp.getPC().setType(PETSc.PC.Type.ILU)
    ksp.setTolerances(rtol=1e-8, max_it=MOST)
    ksp.setOperators(matrix)
    x, b = matrix.createVecs()
    b.array[:] = np.random.default_rng(1).standard_normal(len(A))
    ksp.solve(b, x)
    iterations = ksp.getIterationNumber() if ksp.getConvergedReason() > 0 else None
    for item in (ksp, matrix, x, b):
        item.destroy()
    return iterations


def newton(problem: rf.Scene) -> float:
    """Mean Newton iterations of twenty steps."""
    return float(np.mean([r.iterations for r in rf.simulate(problem, DT, 20 * DT)][1:]))


def compare(short: bool) -> list[dict[str, Any]]:
    """An entry for each way to treat the stiff half; on one rank only."""
    reduced, _ = tangent(scene(RATIO, rigid=True, short=short))
    problem = scene(RATIO, rigid=False, short=short)
    flexible, x = tangent(problem)
    nodes = problem.nodes("stiff", "hard cases")
    penalty = tied(flexible, x, nodes, PENALTY * np.diag(flexible).max())
    steps = {
        "a rigid body": (reduced, newton(scene(RATIO, rigid=True, short=short))),
        "a flexible part": (flexible, newton(problem)),
        "tied by a penalty": (penalty, None),  # a matrix only: rigidfx has no penalties
    }
    return [
        {
            "case": f"stiff half as {way}",
            "group": "rigid bodies",
            "hard": "stiffness ratio 1e8",
            "way": way,
            "condition": condition(matrix),
            "krylov": krylov(matrix),
            "newton_mean": mean,
            "stable": mean is not None and mean <= 5,
        }
        for way, (matrix, mean) in steps.items()
    ]

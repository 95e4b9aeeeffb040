"""A stiff half of a bar: as a rigid body, as a flexible part, or tied by a penalty.

The matrices are the tangents of one step. Rotations are multiplied by the length ℓ, moments divided
by it, and rows and columns scaled by the square root of the diagonal. A bar of 8 × 2 × 2 cells has
these condition numbers:

    E stiff / E soft   rigid body   flexible   tied     tied, without cells
                   1         15.4       16.3    1.1e5                 1.1e5
              10 000         15.4      1.5e5    8.8e8                 1.1e5
         100 000 000         15.4      1.5e9   8.8e12                 1.1e5
"""

from contextlib import closing
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import rigidfx as rf
from rigidfx.mechanics.rotation import skew

from .extremes import SPIN, two_halves

E, NU, RHO = 1e4, 0.3, 10.0  # Pa, 1, kg/m³; of the soft half
DT = 0.1  # s
STEPS = 3  # steps before the tangent is looked at
PENALTY = 1e3  # p over the largest diagonal entry


def scene(ratio: float, rigid: bool, short: bool) -> rf.Scene:
    """The bar with its stiff half rigid or flexible."""
    stiff, soft = (rf.StVenantKirchhoff(E=k * E, nu=NU, rho=RHO) for k in (ratio, 1.0))
    return two_halves(short, stiff, soft, SPIN, *[rf.Rigid("stiff")] * rigid)


class KeepingLU:
    """A preconditioner of PETSc that solves directly and keeps a copy of its last matrix."""

    dense = np.empty((0, 0))

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise a new matrix."""
        matrix = pc.getOperators()[1].convert("aij", PETSc.Mat())
        KeepingLU.dense = np.array(matrix[:, :])
        self._solver = PETSc.PC().create(matrix.comm)
        self._solver.setOperators(matrix)
        self._solver.setType(PETSc.PC.Type.LU)
        self._solver.setUp()

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve."""
        self._solver.apply(b, x)


def tangent(problem: rf.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Dense tangent of the last step at its end, and the nodes' positions there; on one rank."""
    options = PETSc.Options("rigidfx_")
    mine = {"pc_type": "python", "pc_python_type": f"{__name__}.{KeepingLU.__name__}"}
    for name, value in mine.items():
        options[name] = value
    try:
        with closing(rf.simulate(problem, DT, 1.0, progress=False)) as run:
            state = [next(run) for _ in range(1 + STEPS)][-1].state
            return KeepingLU.dense, state.X + state.u.x.array.reshape(-1, 3)
    finally:
        for name in mine:
            options.delValue(name)


def tied(K: np.ndarray, x: np.ndarray, nodes: np.ndarray, p: float) -> np.ndarray:
    """K with springs p |dᵢ - Δr - θ × vᵢ|²/2 between nodes and six extra unknowns (Δr, ℓθ)."""
    v = x[nodes] - x[nodes].mean(axis=0)
    length = np.sqrt((v**2).sum() / len(v))
    rows = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
    L = np.concatenate([np.tile(np.eye(3), (len(v), 1)), -skew(v).reshape(-1, 3) / length], axis=1)
    n = len(K)
    out = np.zeros((n + 6, n + 6))
    out[:n, :n] = K
    out[rows, rows] += p
    out[rows, n:] = -p * L
    out[n:, rows] = -p * L.T
    out[n:, n:] = p * L.T @ L
    return out


def condition(A: np.ndarray) -> float:
    """2-norm condition number of D⁻½ A D⁻½, D the diagonal of A."""
    d = 1 / np.sqrt(np.abs(np.diag(A)))
    return float(np.linalg.cond(d[:, None] * A * d))


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
    # Cells that are left out: theirs are next to nothing, and masses are lumped.
    bare, _ = tangent(scene(1e-9, rigid=False, short=short))
    of_equal, _ = tangent(scene(1.0, rigid=True, short=short))

    def penalty(A: np.ndarray) -> tuple[np.ndarray, None]:  # a matrix only: rigidfx has none
        return tied(A, x, nodes, PENALTY * np.diag(A).max()), None

    steps = {
        "a rigid body": (reduced, newton(scene(RATIO, rigid=True, short=short))),
        "a flexible part": (flexible, newton(problem)),
        "tied by a penalty": penalty(flexible),
        "tied, without cells": penalty(bare),
        "a rigid body, ratio 1": (of_equal, newton(scene(1.0, rigid=True, short=short))),
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


def check(ways: list[dict[str, Any]]) -> None:
    """Assert that a body's stiffness appears nowhere, and that penalties condition worse."""
    body, flexible, penalty, bare, of_equal = ways
    assert body["krylov"] is not None
    assert body["newton_mean"] <= min(4, flexible["newton_mean"])
    assert 1e4 * body["condition"] < flexible["condition"] < penalty["condition"]
    assert 100 * body["condition"] < bare["condition"]
    assert abs(body["condition"] / of_equal["condition"] - 1) <= 1e-6

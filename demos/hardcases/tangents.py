"""Tangents of a bar whose one half is stiff: rigid, flexible, or tied by a penalty."""

from __future__ import annotations

from contextlib import closing

import numpy as np
from petsc4py import PETSc

import rigidfx as rf
from rigidfx.mechanics.rotation import skew

E, NU, RHO = 1e4, 0.3, 10.0  # Pa, 1, kg/m³; of the soft half
DT = 0.1  # s
STEPS = 3  # steps before the tangent is looked at
PENALTY = 1e3  # p over the largest diagonal entry
SPIN = rf.InitialVelocity(angular=(0.2, 0.3, 1.0))  # rad/s


def scene(ratio: float, rigid: bool, short: bool) -> rf.Scene:
    """The bar with its stiff half rigid or flexible."""
    domain = rf.box((0, 0, 0), (8, 2, 2), (4, 1, 1) if short else (8, 2, 2))
    domain = domain.with_cells("stiff", lambda x: x[0] <= 4 + 1e-9)
    domain = domain.with_cells("soft", lambda x: x[0] >= 4 - 1e-9)
    materials = {
        "stiff": rf.StVenantKirchhoff(E=ratio * E, nu=NU, rho=RHO),
        "soft": rf.StVenantKirchhoff(E=E, nu=NU, rho=RHO),
    }
    effects = [SPIN, rf.Rigid("stiff")] if rigid else [SPIN]
    return rf.Scene(domain, materials, effects)


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

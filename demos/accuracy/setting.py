"""The knobs of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

import rigidfx as rf

SOLVERS: dict[str, dict[str, Any]] = {
    "automatic": {},
    "direct": {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"},
    "Krylov": {"ksp_type": "gmres", "pc_type": "bjacobi", "ksp_rtol": 1e-8, "ksp_max_it": 1000},
}


@dataclass(frozen=True)
class Setting:
    """The knobs of a run.

    Attributes:
        tol: Strain rate below which cells become rigid [1/s]; nothing does if 0.
        window: How long it is observed [s].
        dt: Δt [s].
        damping: ξΔt [s].
        refine: Cells per edge of a cell of the base mesh.
        order: Of the displacement.
        mass: "lumped" or "consistent".
        newton: Reduction of the residual at which Newton's iteration ends.
        solver: A key of `SOLVERS`.
        budget: Of `Accuracy`, which chooses Δt, up to `dt`, and what becomes rigid; neither is
            chosen if 0.
    """

    tol: float
    window: float
    dt: float
    damping: float
    refine: int = 1
    order: int = 2
    mass: str = "lumped"
    newton: float = 1e-6
    solver: str = "automatic"
    budget: float = 0.0

    @property
    def effects(self) -> list[rf.effects.Effect]:
        """The damping, if there is any: of a Δt that changes, as the viscous stress that it is."""
        if not self.damping:
            return []
        if self.budget:
            return [rf.StiffnessDamping(ratio=self.damping * np.pi, frequency=1.0)]
        return [rf.NumericalDamping(self.damping / self.dt)]


@contextmanager
def petsc_options(setting: Setting) -> Iterator[None]:
    """Newton's tolerance and the solver, while a run lasts."""
    database = PETSc.Options("rigidfx_")
    wanted = {"snes_rtol": setting.newton, **SOLVERS[setting.solver]}
    for name, value in wanted.items():
        database[name] = value
    try:
        yield
    finally:
        for name in wanted:
            database.delValue(name)

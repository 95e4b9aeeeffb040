"""The knobs of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

import rigidfx as rf


@dataclass(frozen=True)
class Setting:
    """The knobs of a run.

    Attributes:
        tol: Strain rate below which cells become rigid [1/s]; nothing does if 0.
        window: How long it is observed [s].
        dt: Δt [s].
        damping: β = ξΔt, of the damping [s].
        refine: Cells per edge of a cell of the base mesh.
        order: Of the displacement.
        mass: "lumped" or "consistent".
        newton: Reduction of the residual at which Newton's iteration ends.
        budget: Of `Accuracy`, which chooses Δt, up to `dt`, and what becomes rigid; neither is
            chosen if 0.
    """

    tol: float
    window: float
    dt: float
    damping: float
    refine: int = 1
    order: int = 1
    mass: str = "lumped"
    newton: float = 1e-6
    budget: float = 0.0

    @property
    def effects(self) -> list[rf.effects.Effect]:
        """The damping, if there is any: the viscous stress that a numerical one of ξ makes."""
        if not self.damping:
            return []
        return [rf.StiffnessDamping(ratio=self.damping * np.pi, frequency=1.0)]


@contextmanager
def petsc_options(setting: Setting) -> Iterator[None]:
    """Newton's tolerance, while a run lasts."""
    database = PETSc.Options("rigidfx_")
    database["snes_rtol"] = setting.newton
    try:
        yield
    finally:
        database.delValue("snes_rtol")

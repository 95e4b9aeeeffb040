"""The data of one trial of a step, which its equations do not change."""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.mechanics.body_step import Step

__all__ = ["Trial"]


@dataclass(frozen=True)
class Trial:
    """One trial of a step, or of statics.

    Attributes:
        dt: Δt [s]; of no meaning in statics.
        v0: Velocity of the active nodes at the start of the step [m/s]; None in statics.
        imposed: Increments of the held dofs [m].
        start: Displacements of the active nodes at the start of the step [m].
        bodies: The step of the bodies.
    """

    dt: float
    v0: PETSc.Vec
    imposed: Array
    start: Array
    bodies: Step

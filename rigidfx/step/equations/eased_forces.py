"""Eased stresses as an action: stresses of flexible cells that fade."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.mass import without_zeros
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Action
from rigidfx.effects.motion import Motion, Tangent
from rigidfx.flexible.eased_stress import EasedStress
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.eased import Eased

__all__ = ["EasedForces"]


class EasedForces(Action):
    """Stresses that one release has eased, in the cells that are flexible still."""

    kind = "Easing"

    def __init__(
        self, stress: EasedStress, eased: Eased, rows: Rows, u0: Array, flexible: Cells
    ) -> None:
        """Assemble G once. Collective.

        Args:
            stress: Form of G.
            eased: The released cells.
            rows: Rows of the nodes that take part in a step.
            u0: Displacements of all local dofs at the start of a step [m], changed by each step.
            flexible: Owned flexible cells by subdomain id.
        """
        self._stress, self._eased, self._u0, self._dofs = stress, eased, u0, rows.dofs
        self._shapes = stress.shapes(eased)
        self._G = without_zeros(rows.assembled(stress.bind(self._own(flexible), self._shapes)))
        # Places from the middle of all, as G loses what they have in common.
        self._x, self._f, self._still = (rows.vector() for _ in range(3))
        count = rows.comm.allreduce(rows.nodes.size)
        self._x.array[:] = (rows.X - rows.comm.allreduce(rows.X.sum(axis=0)) / count).reshape(-1)
        self._G.mult(self._x, self._still)
        self._condensed: CondensedMatrix | None = None
        self._part = 1.0
        largest = PETSc.NormType.INFINITY
        self.rounding = float(self._G.norm(largest) * self._x.norm(largest))

    def _own(self, cells: Cells) -> Cells:
        """Those that were released."""
        return {i: np.intersect1d(own, self._eased.cells) for i, own in cells.items()}

    def set_time(self, t: float, dt: float) -> None:
        """See `Action`."""
        self._part = self._eased.part(t)

    @property
    def over(self) -> bool:
        """Whether nothing was left in the step that time was set for last."""
        return self._part == 0.0

    def add_impulse(self, dt: float, out: Array) -> None:
        """Add the impulse of the last step of length dt [s] to impulses on owned dofs [N s]."""
        out[self._dofs] += dt * self._part * self._f.array_r

    def _resistance(self, d: PETSc.Vec) -> PETSc.Vec:
        """G x½ for increments d. Collective."""
        self._x.array[:] = self._u0[self._dofs] + 0.5 * d.array_r
        self._G.multAdd(self._x, self._still, self._f)
        return self._f

    def resist(self, motion: Motion, forces: Any) -> None:
        """Add the remaining part of G x½, at nodes of bodies as well."""
        forces.vector.axpy(self._part, self._resistance(motion.d))

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """Add half of the remaining G."""
        prolongation: Prolongation = tangent.prolongation
        if self._condensed is None:
            part, dealt = prolongation.layout, prolongation.dealt
            copies = None if dealt is None else dealt.cells
            both = part.interior, part.interface

            def forms(parts: Iterable[Cells]) -> tuple[fem.Form, fem.Form]:
                inside, beside = (self._stress.bind(p, self._shapes, copies) for p in parts)
                return inside, beside

            # Of the tangent's pattern, whichever cells were released.
            self._condensed = CondensedMatrix(prolongation, *forms(both))
            self._condensed.assemble(forms(map(self._own, both)))
            self._condensed.matrix.assemble()
        tangent.matrix.add(self._condensed, 0.5 * self._part)

    def taken(self, motion: Motion) -> float:
        """Remaining part of x½ᵀ G Δx: the work that fades away [J]."""
        return self._part * float(self._resistance(motion.d).array_r @ motion.array_r)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._G, self._x, self._f, self._still, self._condensed):
            if item is not None:
                item.destroy()

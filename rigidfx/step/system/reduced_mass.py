"""The mass of the unknowns of a division, and velocities by momenta."""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.linear.linear_solver import conjugate_gradients

__all__ = ["ReducedMass"]


class ReducedMass:
    """Lᵀ M L + the bodies' own where the bodies were at first; made when it is needed first.

    Attributes:
        p: Map between unknowns and dofs.
        mass: The mass of nodes, M.
    """

    def __init__(self, p: Prolongation, mass: Mass, bodies: Bodies) -> None:
        """Take its parts."""
        self.p, self.mass, self._bodies = p, mass, bodies
        self._matrix: PETSc.Mat | None = None
        self._r, self._y = p.unknowns(), p.unknowns()

    @property
    def matrix(self) -> PETSc.Mat:
        """It [kg]. Collective."""
        if self._matrix is None:
            now = self.p.increments
            self.p.pose(self._bodies)
            M = self.mass.matrix()
            self._matrix = self.p.condense(M)
            M.destroy()
            self.p.add_blocks(self._matrix, self._bodies.mass_blocks)
            self.p.increments = now
        return self._matrix

    def solve(self, momenta: Array) -> Array:
        """Velocities of this rank's unknowns by their momenta. Collective."""
        self._r.array[:] = momenta
        self._y.set(0.0)
        if self._r.norm() > 0.0:
            conjugate_gradients(self.matrix, self._r, self._y)
        return self._y.array_r.copy()

    def followed(self, w: PETSc.Vec, momenta: PETSc.Vec) -> None:
        """Velocities of all rows by impulses on held ones. Collective.

        Args:
            w: Given velocities of the held rows, zero elsewhere; those of all rows afterwards.
            momenta: M w, overwritten.
        """
        p = self.p
        given = w.array_r[p.prescribed].copy()
        self.mass.mult(w, momenta)
        p.restrict(momenta, p.no_bodies, self._r)
        if self._r.norm() == 0.0:  # no mass couples held rows to others
            return
        self.solve(-self._r.array_r)
        p.apply(self._y, p.bodies_part(self._y), given, w)
        self.mass.mult(w, momenta)

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._matrix, self._r, self._y):
            if item is not None:
                item.destroy()

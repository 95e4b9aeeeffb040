"""GMRES with incomplete factors and a coarse grid, of a tangent that is kept.

Incomplete factors pass information on by some cells. The farther waves get in a step, the more
iterations GMRES needs with them alone: 4 to a hundredth in an L of 27 000 unknowns, 8 at 197 000 in
the same Δt. The error that they leave hardly strains over some cells. A coarse grid removes it; its
unknowns are the rigid motions P of aggregates of nodes. The coarse correction comes first, then
that of the factors,

    z_c = P (Pᵀ A P)⁻¹ Pᵀ r,    z = z_c + M⁻¹ (r - A z_c),

where A P is known, so that its product costs a fifth of one with A. PETSc's PCMG of type kaskade is
the same with another product with A.
"""

from __future__ import annotations

from typing import Protocol

from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.step.equations.equations import Equilibrium
from rigidfx.step.linear.linear_solver import configure
from rigidfx.step.newton.aggregates import Aggregates
from rigidfx.step.newton.incomplete import OWN, IncompleteFactors

__all__ = ["CoarseGrid", "TwoLevels"]

COARSE = OWN + "coarse_"  # prefix of the coarse solver's options


class Tangent(Protocol):
    """Equations as a coarse grid sees them."""

    @property
    def tangent_matrix(self) -> PETSc.Mat:
        """Their matrix."""

    @property
    def prolongation(self) -> Prolongation:
        """Map between its unknowns and nodes."""

    @property
    def positions(self) -> Array:
        """Places of the nodes, shape (nodes, 3) [m]."""


class CoarseGrid:
    """A preconditioner of PETSc's in Python: a coarse correction, then that of another one."""

    def __init__(self, equilibrium: Tangent, fine: PETSc.PC) -> None:
        """Divide the nodes into aggregates. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
            fine: The other preconditioner.
        """
        self.fine = fine
        self._equilibrium = equilibrium
        self._aggregates = Aggregates(equilibrium.prolongation)
        self._left = equilibrium.prolongation.unknowns()
        self._grid: list[PETSc.Object] = []  # all that belongs to one tangent

    def setUp(self, pc: PETSc.PC) -> None:
        """PETSc's call: make both of a new tangent. Collective."""
        A = self._equilibrium.tangent_matrix
        self.fine.setOperators(A)
        self.fine.setUp()
        self._free()
        self._P = self._aggregates.motions(self._equilibrium.positions)
        # In the only format in which products can be made.
        rows = A.convert(PETSc.Mat.Type.AIJ, out=PETSc.Mat())
        self._image = rows.matMult(self._P)
        rows.destroy()
        coarse = self._P.transposeMatMult(self._image)
        self._motion, self._resultant = coarse.createVecs()
        self._coarse = PETSc.KSP().create(coarse.comm)
        self._coarse.setOptionsPrefix(COARSE)
        configure(self._coarse, True, coarse.size[0], False)
        self._coarse.setOperators(coarse)
        self._coarse.setUp()
        self._grid = [self._P, self._image, coarse, self._motion, self._resultant, self._coarse]

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call: z of the module's text. Collective."""
        self._P.multTranspose(r, self._resultant)
        self._coarse.solve(self._resultant, self._motion)
        self._image.mult(self._motion, self._left)
        self._left.aypx(-1.0, r)
        self.fine.apply(self._left, z)
        self._P.multAdd(self._motion, z, z)

    def _free(self) -> None:
        for item in self._grid:
            item.destroy()
        self._grid.clear()

    def destroy(self, pc: PETSc.PC) -> None:
        """PETSc's call: free both. Collective."""
        self._free()
        self.fine.destroy()
        self._left.destroy()


class TwoLevels(IncompleteFactors):
    """As `IncompleteFactors`, with a coarse grid; `destroy` frees it."""

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Create the solver. Collective.

        Args:
            equilibrium: The equations whose tangent it is.
        """
        super().__init__(equilibrium)
        # The factors stay as they are, and as PETSc's options would have them.
        self._grid = CoarseGrid(equilibrium, self._ksp.getPC())
        both = PETSc.PC().create(self._ksp.comm)
        both.setType(PETSc.PC.Type.PYTHON)
        both.setPythonContext(self._grid)
        both.setOperators(equilibrium.tangent_matrix)
        self._ksp.setPC(both)
        both.destroy()  # the solver has it

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._ksp.getType()}+{self._grid.fine.getType()}+coarse"

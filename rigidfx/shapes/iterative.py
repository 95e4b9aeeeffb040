"""Conjugate gradients with two levels, for structures whose factors would take too much memory.

The preconditioner is `CoarseGrid`, made symmetric by a second coarse correction,

    z = C r + B (r - A C r),    z ← z + C (r - A z),    C = P (PᵀAP)⁻¹ Pᵀ,

with incomplete Cholesky factors B and the rigid motions P of aggregates of nodes.
"""

from dataclasses import dataclass

from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.linear.linear_solver import default_options
from rigidfx.step.newton.two_levels import CoarseGrid

PREFIX = "rigidfx_shapes_"
# Residual over the right side: responses are then exact to 1e-7 of their size in slender parts, a
# tenth of what makes a vector a new one (`INDEPENDENT`).
RESIDUAL = 1e-10

ALONE = {"pc_type": "icc", "pc_factor_shift_type": "positive_definite"}
TOGETHER = {"pc_type": "bjacobi"} | {f"sub_{name}": value for name, value in ALONE.items()}


@dataclass(frozen=True)
class Fixed:
    """Equations with a matrix that stays, at places of nodes, as a coarse grid sees them."""

    tangent_matrix: PETSc.Mat
    prolongation: Prolongation
    positions: Array


class SymmetricGrid(CoarseGrid):
    """The coarse correction before and after that of the incomplete factors."""

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call: z of the module's text. Collective."""
        super().apply(pc, r, z)
        self._equations.tangent_matrix.mult(z, self._left)
        self._left.aypx(-1.0, r)
        self._P.multTranspose(self._left, self._resultant)
        self._coarse.solve(self._resultant, self._motion)
        self._P.multAdd(self._motion, z, z)


def conjugate_gradients(A: PETSc.Mat, prolongation: Prolongation, places: Array) -> PETSc.KSP:
    """A solver, which owns its matrix and diverges where this is not definite. Collective.

    The matrix is symmetric, without motions of no stiffness; places are of nodes, (nodes, 3) [m].
    """
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    fine = PETSc.PC().create(A.comm)
    fine.setOptionsPrefix(PREFIX)
    ksp, both = PETSc.KSP().create(A.comm), PETSc.PC().create(A.comm)
    both.setType(PETSc.PC.Type.PYTHON)
    both.setPythonContext(SymmetricGrid(Fixed(A, prolongation, places), fine))
    both.setOperators(A)
    ksp.setOperators(A)
    ksp.setPC(both)
    both.destroy()  # the solver has it
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
    ksp.setTolerances(rtol=RESIDUAL, atol=0.0)
    with default_options(PREFIX, **(ALONE if A.comm.size == 1 else TOGETHER)):
        fine.setFromOptions()
        ksp.setUp()
    return ksp

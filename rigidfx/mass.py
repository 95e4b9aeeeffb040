"""The two mass operators: diagonal, and consistent.

Both act on full-length PETSc vectors of the displacement space and add themselves to a tangent.
A run uses one of them throughout: mixing them breaks the conservation of angular momentum.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from rigidfx.internal import Cells
from rigidfx.kernels import Kernel
from rigidfx.scene import Scene

__all__ = ["ConsistentMass", "LumpedMass", "Mass", "mass_operator"]


class Mass(Protocol):
    """What a mass operator does."""


    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Out = M v."""
        ...

    def add_to(self, K: PETSc.Mat, factor: float) -> None:
        """K += factor · M; K has the pattern of the tangent."""
        ...

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it."""
        ...

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        ...


class LumpedMass:
    """Diagonal mass: one number per node, three times."""

    def __init__(self, scene: Scene) -> None:
        """Take the nodal masses of the scene."""
        n = scene.owned_nodes
        self._diagonal = PETSc.Vec().createWithArray(
            np.repeat(scene.nodal_mass[:n], 3), comm=scene.comm
        )

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Out = M v."""
        out.pointwiseMult(self._diagonal, v)

    def add_to(self, K: PETSc.Mat, factor: float) -> None:
        """K += factor · M."""
        scaled = self._diagonal.duplicate()
        self._diagonal.copy(scaled)
        scaled.scale(factor)
        K.setDiagonal(scaled, PETSc.InsertMode.ADD_VALUES)
        scaled.destroy()

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it."""
        M = PETSc.Mat().createAIJ([self._diagonal.sizes] * 2, nnz=1, comm=self._diagonal.comm)
        M.setDiagonal(self._diagonal)
        M.assemble()
        return M

    def destroy(self) -> None:
        """Free the diagonal. Collective."""
        self._diagonal.destroy()


class ConsistentMass:
    """M = ∫ ρ0 Nᵢ Nⱼ dV over the given cells."""

    def __init__(self, scene: Scene, cells: Cells) -> None:
        """Assemble the matrix once. Collective."""
        v, w = ufl.TrialFunction(scene.space), ufl.TestFunction(scene.space)
        dx = ufl.Measure(
            "dx", domain=scene.mesh, metadata={"quadrature_degree": 2 * scene.order + 2}
        )
        form = scene.density() * ufl.inner(v, w) * dx(tuple(cells))
        bound = Kernel(form, [scene.space] * 2, scene.mesh).bind(cells)
        self._matrix = fem_petsc.create_matrix(bound)
        fem_petsc.assemble_matrix(self._matrix, bound)
        self._matrix.assemble()
        self._formats = {self._matrix.getType(): self._matrix}

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Out = M v."""
        self._matrix.mult(v, out)

    def add_to(self, K: PETSc.Mat, factor: float) -> None:
        """K += factor · M."""
        kind = K.getType()
        if kind not in self._formats:
            self._formats[kind] = self._matrix.convert(kind, PETSc.Mat())
        K.axpy(factor, self._formats[kind], PETSc.Mat.Structure.SAME_NONZERO_PATTERN)

    def matrix(self) -> PETSc.Mat:
        """A copy of M; the caller destroys it."""
        return self._matrix.copy()

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        for matrix in self._formats.values():
            matrix.destroy()


def mass_operator(scene: Scene, cells: Cells) -> Mass:
    """The mass operator that a scene asks for."""
    return LumpedMass(scene) if scene.mass == "lumped" else ConsistentMass(scene, cells)

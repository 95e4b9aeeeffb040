"""Static equilibrium of a scene's cells by Newton's method and sparse factors, on one rank."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.static_forces import static_forces

Array = npt.NDArray[np.float64]
Follower = Callable[[Array, float], tuple[Array, csr_array | None]]

TOLERANCE = 1e-6  # of the residual, relative to the load


class Statics:
    """A scene whose dofs of a mask are held.

    Attributes:
        X: Positions of the nodes, shape (nodes, 3) [m].
    """

    def __init__(self, scene: rf.Scene, held: Callable[[Array], Array]) -> None:
        """Compile the forms.

        Args:
            scene: The problem.
            held: Function of X to a mask of the same shape.
        """
        self.scene = scene
        self.X = scene.space.tabulate_dof_coordinates()
        self._free = np.flatnonzero(~held(self.X).reshape(-1))
        self._forces = InternalForces(scene, fem.Function(scene.space))
        self._bound = static_forces(scene, self._forces, self._forces.cells())

    def _residual(self, u: Array) -> Array:
        self._forces.u1.x.array[:] = u
        return fem.assemble_vector(self._bound.residual).array.copy()

    def tangent(self, u: Array) -> csr_array:
        """Of all dofs, at displacements of shape (dofs,) or (nodes, 3)."""
        self._forces.u1.x.array[:] = u.reshape(-1)
        return fem.assemble_matrix(self._bound.interior).to_scipy().tocsr()

    def linear(self, f: Array) -> Array:
        """Displacements under small forces, both of shape (nodes, 3)."""
        u, free = np.zeros(f.size), self._free
        u[free] = _solved(self.tangent(u)[free][:, free], f.reshape(-1)[free])
        return u.reshape(-1, 3)

    def softest(self, u: Array) -> float:
        """Lowest eigenvalue of the tangent of the free dofs, at displacements."""
        K = self.tangent(u)[self._free][:, self._free].toarray()
        return float(np.linalg.eigvalsh((K + K.T) / 2)[0])

    def loaded(self, load: Follower, increments: int) -> Array:
        """Displacements under a load that grows, shape (nodes, 3).

        Args:
            load: Forces, shape (dofs,), at displacements, shape (nodes, 3), and a factor from 0 to
                1; and how they change with the displacements, a matrix, or None.
            increments: Equal steps of the factor.

        Raises:
            RuntimeError: If Newton's method does not converge.
        """
        u, free = np.zeros(self.X.size), self._free
        before = u
        for k in range(1, increments + 1):
            u, before = 2 * u - before, u  # as the last increment went on
            for _ in range(60):
                f, change = load(u.reshape(-1, 3), k / increments)
                r = (f - self._residual(u))[free]
                K = self.tangent(u)
                if np.linalg.norm(r) <= TOLERANCE * np.linalg.norm(f):
                    break
                K = K if change is None else K - change
                u[free] += splu(K[free][:, free].tocsc()).solve(r)
            else:
                raise RuntimeError(f"increment {k} of {increments} does not converge")
        return u.reshape(-1, 3)


def _solved(K: csr_array, f: Array) -> Array:
    """K⁻¹ f by Cholesky factors of MUMPS, K symmetric and positive."""
    A = PETSc.Mat().createAIJ(K.shape, csr=(K.indptr, K.indices, K.data), comm=PETSc.COMM_SELF)
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOperators(A)
    ksp.setType("preonly")
    ksp.pc.setType("cholesky")
    ksp.pc.setFactorSolverType("mumps")
    x, b = A.createVecs()
    b.array[:] = f
    ksp.solve(b, x)
    out = x.array.copy()
    for thing in (ksp, A, x, b):
        thing.destroy()
    if not np.isfinite(out).all():
        raise RuntimeError(f"{f.size} unknowns cannot be factorised: memory may be short")
    return out

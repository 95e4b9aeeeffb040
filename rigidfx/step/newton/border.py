"""Solve linear systems with joints by whatever solves without them.

With Eᵀ from unknowns to ports, D and D₁ from ports to rows H the curvature of the rows and
R what springs of joints yield, the tangent of a step is

    [A + E H Eᵀ    E Dᵀ]
    [D₁ Eᵀ         R   ],

A is solved for each port once with each new tangent, Y = A⁻¹ E; C = Eᵀ Y is the compliance at the
ports. The rest of a solve is a small system in the displacements of the ports, q, and in the
multipliers,

    [I + C H    C Dᵀ] [q]   [Eᵀ A⁻¹ r]
    [D₁         R   ] [μ] = [s       ],    z = A⁻¹ r - Y (H q + Dᵀ μ).

No joint is ever inside incomplete factors. Of a tangent that is kept, ports turn along with the
nodes and bodies that they belong to, as Y and C do; H, D and D₁ are always those of the last
iterate, so that rows are met as by Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import block_diag
from scipy.sparse import block_array, csc_array, eye_array
from scipy.sparse.linalg import splu

from rigidfx.base.errors import StepError
from rigidfx.step.equations.joined import JoinedEquilibrium

__all__ = ["Border", "BorderedFactors"]

Array = npt.NDArray[np.float64]
Solve = Callable[[PETSc.Vec, PETSc.Vec], None]


class Border:
    """Joints around a solver without them; `destroy` frees its vectors.

    Attributes:
        ports: Number of ports: solves that a new tangent takes beside its factors.
    """

    def __init__(self, equilibrium: JoinedEquilibrium) -> None:
        """Take the equations.

        Args:
            equilibrium: The equations, with joints.
        """
        self._equilibrium, ports = equilibrium, equilibrium.ports
        self.ports = ports.count
        self._E = ports.entries
        self._owned = equilibrium.prolongation.owned
        self._r, self._z = (equilibrium.prolongation.unknowns() for _ in range(2))
        self._Y: Array = np.empty((self._owned, 0))
        self._C = csc_array((0, 0))
        self._turned: csc_array | None = None

    def _sum(self, values: Array) -> Array:
        comm = self._equilibrium.prolongation.comm
        if comm.size > 1:
            comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def renew(self, solve: Solve) -> None:
        """Take note of a new tangent. Collective.

        Args:
            solve: Solves with it, A z = r.
        """
        columns = self._E.tocsc()
        self._Y = np.empty((self._owned, self.ports), order="F")
        for k in range(self.ports):
            own = slice(columns.indptr[k], columns.indptr[k + 1])
            self._r.set(0.0)
            self._r.array[columns.indices[own]] = columns.data[own]
            solve(self._r, self._z)
            self._Y[:, k] = self._z.array_r
        self._C = csc_array(self._sum(np.ascontiguousarray(self._E.T @ self._Y)))
        self._turned = None

    def turn(self, starts: npt.NDArray[np.int32], Q: Array | None) -> None:
        """Take note of how nodes and bodies have turned since the tangent was made. Collective.

        Args:
            starts: Where vectors among this rank's unknowns begin.
            Q: Rotation of each, shape (vectors, 3, 3); None if none has.
        """
        self._turned = None
        if Q is None:
            return
        weights = self._E[starts][:, ::3]
        sums = self._sum(np.asarray(weights.power(2).T @ Q.reshape(-1, 9))).reshape(-1, 3, 3)
        sums[np.abs(sums).max(axis=(1, 2)) == 0.0] = np.eye(3)  # nodes that are held in part
        W, _, Vt = np.linalg.svd(sums)
        self._turned = csc_array(block_diag(*(W @ Vt)))

    def solve(self, solve: Solve, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve with joints. Collective.

        Args:
            solve: Solves without them.
            r: Right-hand side, in the frame of the tangent.
            z: Solution, overwritten.
        """
        equilibrium = self._equilibrium
        self._r.array[:] = r.array_r[: self._owned]
        solve(self._r, self._z)
        q = self._sum(np.asarray(self._E.T @ self._z.array_r))
        H, D, D1, R = equilibrium.border()
        if self._turned is not None:
            B = self._turned
            H, D, D1 = B.T @ H @ B, D @ B, D1 @ B
        right = np.r_[q, equilibrium.of_joints(r.array_r)]
        n = self.ports
        C = self._C
        matrix = block_array([[eye_array(n) + C @ H, C @ D.T], [D1, R]], format="csc")
        try:
            found = splu(matrix).solve(right)
        except RuntimeError:  # SuperLU's word for a singular matrix
            raise StepError(
                "The joints and motors leave no motion, or hold what they hold already: their "
                "equations are singular.",
                "Look for motors that drive the same parts, or for a pose in which the mechanism "
                "locks; smaller steps may pass that.",
            ) from None
        out = z.array
        out[: self._owned] = self._z.array_r - self._Y @ (H @ found[:n] + D.T @ found[n:])
        out[self._owned :] = found[n:][: out.size - self._owned]

    def destroy(self) -> None:
        """Free the vectors. Collective."""
        self._r.destroy()
        self._z.destroy()


class BorderedFactors:
    """A preconditioner of PETSc's in Python: all of a linear solve, by factors of each tangent.

    Attributes:
        inner: Solves without joints.
    """

    def __init__(self, equilibrium: JoinedEquilibrium) -> None:
        """Create the solver within. Collective.

        Args:
            equilibrium: The equations, with joints.
        """
        self.inner = PETSc.KSP().create(equilibrium.prolongation.comm)
        self._equilibrium, self._border = equilibrium, Border(equilibrium)

    def within(self, ksp: PETSc.KSP) -> PETSc.KSP:
        """Have a solver of SNES's solve by this; the one within, which is to be configured."""
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(self)
        return self.inner

    @property
    def operator(self) -> PETSc.Mat:
        """A matrix of the right size for SNES, without entries. Collective."""
        y = self._equilibrium.unknowns()
        empty = PETSc.Mat().createAIJ([y.sizes] * 2, nnz=0, comm=y.comm)
        empty.assemble()
        y.destroy()
        return empty

    def renew(self) -> None:
        """Take note of a new tangent. Collective."""
        self.inner.setOperators(self._equilibrium.tangent_matrix)
        self._border.renew(self.inner.solve)

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call. Collective."""
        self._border.solve(self.inner.solve, r, z)

    def destroy(self, pc: PETSc.PC) -> None:
        """PETSc's call: free the inner solver. Collective."""
        self.inner.destroy()
        self._border.destroy()

"""The linear equations of bodies that strain a little, each in its frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from rigidfx.base.taken import read_only
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.shadow.margin import Margin
from rigidfx.step.linear import cholmod
from rigidfx.step.linear.linear_solver import default_options

__all__ = ["PREFIX", "LinearPart", "solver_of"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

PREFIX = "rigidfx_shadow_"
FAINT = 1e-8  # part of its stiffness that holds a margin where it is in bodies' frames
KINDS = 3  # of steps whose factors are kept: short, long and very long ones


class LinearPart:
    """M δ̈ + C δ̇ + K δ = ρ, and K δ = ρ, with kept factors; `destroy` frees them."""

    def __init__(self, margin: Margin, linear: LinearForms, dashpots: Array) -> None:
        """Assemble the matrices and factor the static one. Collective.

        Args:
            margin: The bodies, and what gives way with them.
            linear: Forms, whose shape is that of the margin.
            dashpots: Constants of dashpots at the nodes of the rows, which act on shadows [N s/m].
        """
        self._mass = margin.mass()
        rows, self._inside = margin.rows, margin.inside
        self._K = _assembled(rows, linear.stiffness(margin.cells))
        self._around = _assembled(rows, linear.stiffness(margin.around))
        self._M = self._mass.matrix()
        viscosity = linear.viscosity(margin.cells)
        self._viscosity = None if viscosity is None else _assembled(rows, viscosity)
        self._first, self._held, self._supported = rows.first, margin.held(), margin.supported_rows
        self._unmoved = margin.unmoved
        still = self._K.copy()
        # What hangs on a body by a node or an edge may turn round it.
        diagonal = self._K.getDiagonal()
        diagonal.array[:] *= np.repeat(FAINT * margin.outside, 3)
        still.setDiagonal(diagonal, PETSc.InsertMode.ADD_VALUES)
        diagonal.destroy()
        self._scale = float(self._K.getDiagonal().norm()) / np.sqrt(rows.comm.size)
        self._hold(still, self._held, self._scale)
        self._static = solver_of(still)
        self._dynamic: dict[tuple[float, float, float], PETSc.KSP] = {}
        self._right, self._found, self._work, self._dashpots = (rows.vector() for _ in range(4))
        self._dashpots.array[:] = np.repeat(dashpots, 3)
        self._rest: tuple[Array | None, Array] = None, np.empty((0, 3))

    def _hold(self, A: PETSc.Mat, rows: Ints, scale: float) -> None:
        A.zeroRowsColumns((self._first + rows).astype(PETSc.IntType), diag=scale)

    def at_rest(self, force: Array) -> Array:
        """K⁺ρ: how the bodies strain under a steady force, but for a rigid motion. Collective.

        That of the last force is kept.

        Args:
            force: ρ on the nodes of the rows, in balance, shape (nodes, 3) [N]; not to be changed.

        Returns:
            Displacements in the bodies' frames, shape (nodes, 3) [m].
        """
        if force is not self._rest[0]:
            self._set(force)
            self._rest = force, read_only(self._solved())
        return self._rest[1]

    def strained(self, force: Array) -> Array:
        """K⁺ρ to rounding, and without the rigid motions that it leaves open. Collective.

        What holds margins faintly resists those of the choice of held rows, by FAINT; one
        correction has that squared.

        Args:
            force: As of `at_rest`.
        """
        u = self._unmoved(self.at_rest(force))
        self._found.array[:] = u.reshape(-1)
        self._K.mult(self._found, self._work)
        self._set(force)
        self._right.axpy(-1.0, self._work)
        return self._unmoved(u + self._solved())

    def _solved(self) -> Array:
        """Displacements at rest under the forces on the right, shape (nodes, 3) [m]. Collective."""
        self._right.array[self._held] = 0.0
        self._static.solve(self._right, self._found)
        return self._found.array_r.reshape(-1, 3).copy()

    def energies(self) -> Array:
        """Twice the strain energies of the last response at rest, on this rank [J].

        Returns:
            That of the bodies and their margins, and that of the bodies alone.
        """
        force, u = self._rest
        assert force is not None
        self._right.array[:] = u.reshape(-1)
        self._around.mult(self._right, self._found)
        every = float(np.vdot(force, u[self._inside]))
        return np.array([every, every - float(np.vdot(u, self._found.array_r))])

    def _set(self, force: Array) -> None:
        """Have forces on the nodes of bodies alone on the right."""
        self._right.array[:] = 0.0
        self._right.array.reshape(-1, 3)[self._inside] = force

    def increment(
        self, force: Array, u: Array, v: Array, dt: float, drag: float, xi: float
    ) -> Array:
        """Increment of a step, by the midpoint rule. Collective.

        Args:
            force: ρ at its middle, shape (nodes, 3) [N].
            u: δ at its start [m].
            v: δ̇ at its start [m/s].
            dt: Its length [s].
            drag: α of a force -α M δ̇ [1/s].
            xi: ξ of the numerical damping.

        Returns:
            Δδ, shape (nodes, 3) [m].
        """
        solver = self.factored(dt, drag, xi)
        right, work, found = self._right, self._work, self._found
        work.array[:] = v.reshape(-1) * (2 / dt)
        self._mass.mult(work, right)
        right.array.reshape(-1, 3)[self._inside] += force
        work.array[:] = u.reshape(-1)
        self._K.mult(work, found)
        right.axpy(-1.0, found)
        right.array[self._supported] = 0.0
        solver.solve(right, found)
        return found.array_r.reshape(-1, 3).copy()

    def resolved(self, v: Array, dt: float, drag: float, xi: float) -> Array:
        """Of velocities what a step resolves: of what turns at ω, 1 - (1 - F)⁴. Collective.

        F = 1/(1 + ω²Δt²/4) is what is left of them in the mean over a step.

        Args:
            v: δ̇, shape (nodes, 3) [m/s].
            dt: Length of the step [s].
            drag: α of a force -α M δ̇ [1/s].
            xi: ξ of the numerical damping.
        """
        found, left, nothing = np.zeros_like(v), v, np.zeros((self._inside.size, 3))
        for _ in range(4):
            part = self.increment(nothing, np.zeros_like(v), left, dt, drag, xi) / dt
            found, left = found + part, left - part
        return found

    def factored(self, dt: float, drag: float, xi: float) -> PETSc.KSP:
        """The factors of a step; those of few kinds of steps are kept. Arguments as of `increment`.

        Collective.
        """
        kind = float(f"{dt:.9g}"), drag, xi  # times at the ends of steps are rounded
        if kind not in self._dynamic:
            if len(self._dynamic) == KINDS:
                self._dynamic.pop(next(iter(self._dynamic))).destroy()
            A = self._K.copy()
            A.scale(0.5 + xi)
            A.axpy(2 / dt**2 + drag / dt, self._M, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            if self._viscosity is not None:
                A.axpy(1 / dt, self._viscosity, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            self._dashpots.copy(self._work)
            self._work.scale(1 / dt)
            A.setDiagonal(self._work, PETSc.InsertMode.ADD_VALUES)
            self._hold(A, self._supported, self._scale)
            self._dynamic[kind] = solver_of(A)
        return self._dynamic[kind]

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        own = self._K, self._around, self._M, self._viscosity, self._static, *self._dynamic.values()
        for item in (*own, self._mass, self._right, self._found, self._work, self._dashpots):
            if item is not None:
                item.destroy()


def _assembled(rows: Rows, form: fem.Form) -> PETSc.Mat:
    A = rows.matrix(form)
    fem_petsc.assemble_matrix(A, form)
    A.assemble()
    return A


def solver_of(A: PETSc.Mat) -> PETSc.KSP:
    """A solver with kept factors of a symmetric, definite matrix, which it owns. Collective.

    By CHOLMOD on one rank; by MUMPS on several, and where a material gives way, so that the matrix
    is not definite.
    """
    A.setOption(PETSc.Mat.Option.SPD, True)
    if A.comm.size == 1 and cholmod.exists():
        ksp = cholmod.solver(A.comm, PREFIX)
        if cholmod.factor(ksp, A):
            A.destroy()  # its solver holds it
            return ksp
        ksp.destroy()
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(A)
    given = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
    with default_options(PREFIX, **given):
        ksp.setFromOptions()
    ksp.setUp()
    A.destroy()
    return ksp

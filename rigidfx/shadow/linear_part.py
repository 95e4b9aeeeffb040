"""The linear equations of bodies that strain a little, each in its frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx.base.taken import read_only
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.shadow.linear_motion import LinearMotion, assembled, solver_of
from rigidfx.shadow.margin import Margin

__all__ = ["LinearPart"]

Array = npt.NDArray[np.float64]

FAINT = 1e-8  # part of its stiffness that holds a margin where it is in bodies' frames


class LinearPart(LinearMotion):
    """M δ̈ + C δ̇ + K δ = ρ, and K δ = ρ, with kept factors; `destroy` frees them."""

    def __init__(self, margin: Margin, linear: LinearForms, dashpots: Array) -> None:
        """Assemble the matrices and factor the static one. Collective.

        Args:
            margin: The bodies, and what gives way with them.
            linear: Forms, whose shape is that of the margin.
            dashpots: Constants of dashpots at the nodes of the rows, which act on shadows [N s/m].
        """
        rows, self._inside = margin.rows, margin.inside
        supported = margin.supported_rows
        super().__init__(rows, margin.cells, linear, margin.mass(), supported, dashpots)
        self._around = assembled(rows, linear.stiffness(margin.around))
        self._held, self._unmoved = margin.held(), margin.unmoved
        still = self._K.copy()
        # What hangs on a body by a node or an edge may turn round it.
        diagonal = self._K.getDiagonal()
        diagonal.array[:] *= np.repeat(FAINT * margin.outside, 3)
        still.setDiagonal(diagonal, PETSc.InsertMode.ADD_VALUES)
        diagonal.destroy()
        self._hold(still, self._held, self._scale)
        self._static = solver_of(still)
        self._rest: tuple[Array | None, Array] = None, np.empty((0, 3))

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
        self._push(force)

    def _push(self, force: Array) -> None:
        """Add forces on the right: at the nodes of bodies."""
        self._right.array.reshape(-1, 3)[self._inside] += force

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

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        super().destroy()
        self._around.destroy()
        self._static.destroy()

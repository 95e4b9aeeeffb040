"""How parts strain under steady forces on their nodes, by their own stiffness alone: K⁺ρ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array, Bools
from rigidfx.error.forces.parts import Parts
from rigidfx.error.linear_motion import assembled
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rigid_motions import free_motions
from rigidfx.step.linear.definite import solver_of
from rigidfx.step.stepper import Stepper

__all__ = ["AtRest"]


class AtRest:
    """Some bodies or parts with the factor of their stiffness; `destroy` frees it.

    Attributes:
        bodies: Their data.
    """

    def __init__(
        self, stepper: Stepper, linear: LinearForms, bodies: Sequence[RigidBody], held: Bools
    ) -> None:
        """Factor the stiffness. Collective.

        Args:
            stepper: Knows the cells of each material.
            linear: Forms, which get the shape of the bodies.
            bodies: Their data; they share no node.
            held: For each owned node, which components supports hold.
        """
        scene, comm = stepper.scene, stepper.scene.comm
        self.bodies = tuple(bodies)
        self._parts = parts = Parts(scene, stepper.forces, bodies)
        rows = parts.rows
        linear.shape.x.array[:] = 0.0
        linear.shape.x.array[rows.dofs] = parts.shape
        linear.shape.x.scatter_forward()
        K = assembled(rows, linear.stiffness(parts.cells))
        self._right, self._found = K.getDiagonal(), rows.vector()
        scale = float(self._right.norm()) / np.sqrt(comm.size)
        supported = held[rows.nodes]
        each = zip(bodies, parts.at, strict=True)
        self._free = [free_motions(parts.V[at], supported[at], b.length, comm) for b, at in each]
        numbers = parts.held(self._free) - rows.first
        chosen = numbers[(numbers >= 0) & (numbers < rows.dofs.size)]
        self._fixed = np.union1d(chosen, np.flatnonzero(supported))
        K.zeroRowsColumns((rows.first + self._fixed).astype(PETSc.IntType), diag=scale)
        self._solver = solver_of(K)

    def strained(self, forces: Sequence[Array]) -> list[Array]:
        """Displacements of their nodes, without a rigid motion that nothing prevents. Collective.

        Args:
            forces: On the nodes of each, in its frame, shape (nodes, 3) [N]; in balance where no
                support holds it.

        Returns:
            In the frame of each, shape (nodes, 3) [m].
        """
        parts = self._parts
        self._right.array[:] = parts.of_each(forces).reshape(-1)
        self._right.array[self._fixed] = 0.0
        self._solver.solve(self._right, self._found)
        u = self._found.array_r.reshape(-1, 3).copy()
        u -= parts.linear(parts.rigid_motion(u, self._free))
        return [u[at] for at in parts.at]

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._solver, self._right, self._found):
            item.destroy()

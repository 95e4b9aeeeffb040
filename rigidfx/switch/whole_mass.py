"""The mass matrix of all cells but those in bodies whose mass is given."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene

__all__ = ["WholeMass"]


class WholeMass:
    """Assembles M once for the same bodies of given mass: masses do not change with the motion."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Nothing is assembled.

        Args:
            scene: The problem.
            forces: Internal forces.
        """
        self._scene, self._forces = scene, forces
        self._without: set[int] | None = None  # numbers of the bodies whose mass is given
        self._matrix: PETSc.Mat | None = None

    def matrix(self, bodies: Sequence[RigidBody]) -> PETSc.Mat:
        """M, one row per owned dof, which stays this object's own. Collective.

        Args:
            bodies: All bodies.
        """
        scene, given = self._scene, [body for body in bodies if body.given]
        without = {body.number for body in given}
        if self._matrix is not None and without == self._without:
            return self._matrix
        if self._matrix is not None:
            self._matrix.destroy()
        every = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        theirs = np.concatenate([every[:0], *(body.cells for body in given)])
        counted = np.ones(scene.owned_nodes, dtype=bool)
        for body in given:
            counted[body.nodes] = False
        rows = Rows(scene.space, np.arange(scene.owned_nodes, dtype=np.int32))
        cells = self._forces.cells(np.setdiff1d(every, theirs))
        operator = mass_operator(scene, rows, cells, counted)
        self._matrix, self._without = operator.matrix(), without
        operator.destroy()
        return self._matrix

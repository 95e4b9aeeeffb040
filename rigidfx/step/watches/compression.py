"""Is any enhanced cell compressed so far that it may buckle into hourglasses?

St.Venant and Kirchhoff's material has no stable state of strong compression. A cube of 4 × 4 × 4
cells between walls, ν = 0.3, squeezed along one axis, loses its stability at a stretch of 0.65 with
standard cells and of 0.70 with enhanced ones, whose modes are the first to go (lowest eigenvalues
of `demos/benchmarks/known_answers.py`). No balance tells: energy is conserved all the same.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.step.watches.judge import Attempt, WarnsOnce, name_of_cell

LEAST = 0.75  # stretch that is warned of
EVERY = 8  # steps

# Derivatives of shape functions at the centre by coordinates from 0 to 1; nodes: x fastest.
SLOPES = np.array([[(n >> k & 1) * 0.5 - 0.25 for k in range(3)] for n in range(8)])


class Compression(WarnsOnce):
    """Looks at the least stretch in the middle of flexible hexahedra, in every eighth step."""

    remembered: ClassVar[Remembered] = WarnsOnce.remembered | same("_steps")

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Begin before the first step.

        Args:
            scene: The problem, of first-order hexahedra.
            forces: Internal forces, whose u₁ holds the end of a step.
        """
        super().__init__(scene.comm)
        self._mesh, self._forces = scene.mesh, forces
        self._X: Array = scene.space.tabulate_dof_coordinates()
        self._all = scene.space.dofmap.list
        self._steps = 0
        self.bind({})

    def bind(self, flexible: Cells) -> None:
        """Measure these cells from now on."""
        self._cells = np.concatenate([np.empty(0, np.int32), *flexible.values()])
        self._nodes = self._all[self._cells]
        J = np.einsum("cni,nk->cik", self._X[self._nodes], SLOPES)
        self._gradients = np.einsum("nk,ckj->cnj", SLOPES, np.linalg.inv(J))

    def accept(self, attempt: Attempt) -> None:
        """Measure stretches in every eighth step. Collective."""
        self._steps += 1
        if not self.waits or self._steps % EVERY != 1:
            return
        least, cell = self._least()
        most = self._comm.allreduce(least, op=MPI.MIN)
        if most >= LEAST:
            return
        name = name_of_cell(self._comm, self._mesh, cell if least == most else None)
        self.say(
            f"In the step from t = {attempt.t:.6g} s {name} is compressed to {most:.2g} of its "
            "length. Cells with element='enhanced' may form hourglasses there, below some 0.7, and "
            "standard ones of StVenantKirchhoff are not stable either below 0.65. Take "
            "element='standard' and NeoHooke for strong compression.",
        )

    def _least(self) -> tuple[float, int]:
        """Least stretch of this rank's cells, and which has it; 1 if there are none."""
        if not self._cells.size:
            return 1.0, -1
        u = self._forces.u1.x.array.reshape(-1, 3)[self._nodes]
        F = np.eye(3) + u.mT @ self._gradients
        square = np.linalg.eigvalsh(F.mT @ F)[:, 0]
        k = int(np.argmin(square))
        return float(np.sqrt(max(square[k], 0.0))), int(self._cells[k])

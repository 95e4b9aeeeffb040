"""Rigid motion of stiff parts by the rest of the residual.

A part that is much stiffer than all around it, and floats there, moves against the stiffness of its
surroundings and its inertia, of which no diagonal entry of its own unknowns tells. Neither does the
residual's norm: rounding in the part's own forces is all of that, and a linear solve loses as many
digits of its motion as the stiffnesses are apart. But rounding of stresses adds up to nothing over
the part: the forces and moments on its six rigid motions, and the tangent's stiffness against them,
are known well, so that one 6 × 6 system for each part says how far it is from where it belongs.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.scene.scene import Scene

__all__ = ["StiffParts"]


class StiffParts:
    """The stiff parts of a scene among the unknowns of a division."""

    def __init__(self, scene: Scene, prolongation: Prolongation) -> None:
        """Find their unknowns. Collective.

        Args:
            scene: The problem.
            prolongation: Map between unknowns and dofs.
        """
        self._comm, self._count = scene.comm, 0
        parts = scene.stiff_parts
        if parts is None:
            return
        self._count = parts.count
        dofmap = scene.space.dofmap.list
        part = np.full(len(scene.space.tabulate_dof_coordinates()), -1)
        stiff = np.flatnonzero(parts.of_cell >= 0)
        part[dofmap[stiff]] = parts.of_cell[stiff, None]
        self._p, rows = prolongation, prolongation.layout.rows
        node, axis = np.nonzero(prolongation.free_of_nodes)
        of_node = prolongation.at_nodes(part[rows.nodes, None].astype(np.float64))[:, 0]
        of_free = of_node[node].astype(np.int64)
        self._at = np.flatnonzero(of_free >= 0)
        self._part = of_free[self._at]
        self._node, self._axis = node[self._at], axis[self._at]
        self._middle = 0.5 * (parts.lower + parts.upper)
        self._size = 0.5 * np.linalg.norm(parts.upper - parts.lower, axis=1)

    def left(self, A: PETSc.Mat, R: PETSc.Vec, u: Array) -> float:
        """Largest motion of an unknown by Σ b (b·A b)⁻¹ (b·R), b the rigid motions [m]. Collective.

        Args:
            A: The tangent [N/m].
            R: The residual [N].
            u: Displacements of all local dofs, about which stiff parts move [m].
        """
        if self._count == 0:
            return 0.0
        rows = self._p.layout.rows
        x = self._p.at_nodes(rows.X + u[rows.dofs].reshape(-1, 3))
        modes = self._motions(x[self._node])
        b, image = R.duplicate(), R.duplicate()
        sums = np.zeros((self._count, 6, 7))
        for k in range(6):
            b.set(0.0)
            b.array[self._at] = modes[:, k]
            A.mult(b, image)
            np.add.at(sums[:, :, k], self._part, modes * image.array_r[self._at, None])
        np.add.at(sums[:, :, 6], self._part, modes * R.array_r[self._at, None])
        b.destroy()
        image.destroy()
        sums = np.asarray(self._comm.allreduce(sums, op=MPI.SUM))
        moved = np.stack([np.linalg.lstsq(own[:, :6], own[:, 6])[0] for own in sums])
        most = float(np.abs((modes * moved[self._part]).sum(axis=1)).max(initial=0.0))
        return float(self._comm.allreduce(most, op=MPI.MAX))

    def _motions(self, x: Array) -> Array:
        """Translations, and rotations by 1/size, of unknowns at x, shape (unknowns, 6)."""
        motions = rigid_motions(x - self._middle[self._part], self._size[self._part, None])
        return motions[np.arange(len(self._at)), self._axis]

"""Springs and dashpots between the ground and nodes, or points of faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array, vstack

from rigidfx.base.types import Array
from rigidfx.coupling.remote_mass import add_at_vectors, slopes_of
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Spring
from rigidfx.scene.scene import Scene

__all__ = ["Ground", "ground_of"]


@dataclass(frozen=True)
class Ground:
    """Ties of nodes, and of averages of nodes, to the ground.

    Attributes:
        K: Stiffness at nodes, shape (nodes, 3, 3) [N/m].
        C: Damping, of the same shape [N s/m].
        slopes: Derivatives of each point of a face by nodes, shape (3 · points, 3 · nodes).
        K_points: Stiffness there, shape (points, 3, 3) [N/m].
        C_points: Damping there, of the same shape [N s/m].
    """

    K: Array
    C: Array
    slopes: csr_array
    K_points: Array
    C_points: Array

    def add_to(self, rows: Rows, K: PETSc.Mat, C: PETSc.Mat) -> None:
        """Add stiffness and damping to matrices of all rows. Collective."""
        for A, nodal, points in ((K, self.K, self.K_points), (C, self.C, self.C_points)):
            rows.add_blocks(A, nodal)
            if len(points):
                add_at_vectors(A, self.slopes, points, rows.comm)

    def resistance(self, scene: Scene, motions: Array) -> Array:
        """Stiffness against some motions, shape (motions, motions). Collective.

        Args:
            scene: The problem.
            motions: Displacements of the owned nodes, shape (nodes, 3, motions) [m].
        """
        nodal = np.einsum("nik,nij,njl->kl", motions, self.K, motions)
        moved = np.asarray(scene.sum(self.slopes @ motions.reshape(-1, motions.shape[2])))
        moved = moved.reshape(-1, *motions.shape[1:])
        of_points = np.einsum("pik,pij,pjl->kl", moved, self.K_points, moved)
        return np.asarray(scene.sum(nodal)) + of_points


def ground_of(scene: Scene, rows: Rows) -> Ground | None:
    """The springs of a scene at all owned nodes; None if it has none. Collective."""
    springs = scene.named(Spring)
    if not springs:
        return None
    K, C = np.zeros((2, rows.nodes.size, 3, 3))
    at_points, slopes = [], [csr_array((0, 3 * rows.nodes.size))]
    counted = np.ones(rows.nodes.size, dtype=bool)
    for spring in springs:
        if spring.face is None:
            share = scene.shares(spring.where, spring.kind)[rows.nodes, None, None]
            K += share * spring.K
            C += share * spring.C
            continue
        own = slopes_of(scene, spring.remote.place, rows, counted)
        if own is not None:
            at_points.append((spring.K, spring.C))
            slopes.append(own)
    K_points, C_points = np.reshape(at_points, (-1, 2, 3, 3)).swapaxes(0, 1)
    return Ground(K, C, csr_array(vstack(slopes, format="csr")), K_points, C_points)

"""Rigid faces in the twin: K resists all motions of their nodes but the rigid ones.

Let R be the six rigid motions of a face's nodes, u_a the displacements of a few of them, and q = G
u_a the rigid motion that fits u_a by least squares. The forms

    B u = u - R G u_a

are zero in rigid motions only, and s BᵀB is added to K. B couples each node with these few nodes
only; a projection onto all rigid motions would couple all with all.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array, Ints
from rigidfx.coupling.rows import Rows
from rigidfx.effects import rigid_faces
from rigidfx.mechanics.rigid_motions import independent, rigid_motions
from rigidfx.scene.scene import Scene

__all__ = ["stiff_faces"]

Int = PETSc.IntType


def stiff_faces(scene: Scene, rows: Rows, places: Array, K: PETSc.Mat, times: float) -> None:
    """Make the nodes of each rigid face resist all but rigid motions. Collective.

    Args:
        scene: The problem.
        rows: Rows of all nodes.
        places: Of the owned nodes in the shape, shape (nodes, 3) [m].
        K: Their stiffness; its pattern grows.
        times: s as a multiple of the mean stiffness on the diagonal of a face's rows.
    """
    for face in rigid_faces(scene.effects):
        nodes = scene.nodes(face.where, face.name, (2,))
        nodes = nodes[nodes < scene.owned_nodes]
        own = (3 * nodes[:, None] + np.arange(3)).reshape(-1)
        diagonal = K.getDiagonal()
        sums = scene.sum([float(diagonal.array_r[own].sum()), float(own.size)])
        diagonal.destroy()
        B = _forms(scene, rows, places[nodes], rows.first + own)
        penalty = B.transposeMatMult(B)
        different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        K.axpy(times * float(sums[0] / sums[1]), penalty, different)
        B.destroy()
        penalty.destroy()


def _forms(scene: Scene, rows: Rows, places: Array, numbers: Ints) -> PETSc.Mat:
    """B of a face. Collective.

    Args:
        scene: The problem.
        rows: Rows of all nodes.
        places: Of the face's owned nodes, shape (nodes, 3) [m].
        numbers: Of their rows.
    """
    comm = scene.comm
    counts = np.asarray(scene.sum(np.r_[places.sum(axis=0), float(len(places))]))
    arms = places - counts[:3] / counts[3]
    length = float(np.sqrt(scene.sum(float((arms**2).sum())) / counts[3]))
    R = rigid_motions(arms, length).reshape(-1, 6)
    best = np.unique(independent(R) // 3)
    offers = comm.allgather((arms[best], numbers.reshape(-1, 3)[best]))
    all_arms, all_rows = (np.concatenate([offer[k] for offer in offers]) for k in (0, 1))
    modes = rigid_motions(all_arms, length)
    few = np.unique(independent(modes.reshape(-1, 6)) // 3)
    columns, fit = all_rows[few].reshape(-1), np.linalg.pinv(modes[few].reshape(-1, 6))
    B = PETSc.Mat().create(comm)
    B.setSizes([(numbers.size, None), (rows.dofs.size, None)])
    B.setType(PETSc.Mat.Type.AIJ)
    B.setPreallocationNNZ(columns.size + 1)
    first = comm.exscan(numbers.size) or 0
    here = (first + np.arange(numbers.size)).astype(Int)
    if here.size:
        B.setValues(here, columns.astype(Int), -(R @ fit), PETSc.InsertMode.ADD_VALUES)
    for row, column in zip(here, numbers.astype(Int), strict=True):
        B.setValue(row, column, 1.0, PETSc.InsertMode.ADD_VALUES)
    B.assemble()
    return B

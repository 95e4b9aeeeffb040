"""The kinetic energy with which the parts on some supports would follow a jump of their velocity.

The velocities that supports give to their nodes at an instant are fitted by a rigid motion of each
connected part, the slowest one where several fit, and that is given to all mass of the part. The
energy of the held nodes alone depends on the size of the cells, and hides the blow that is to come.
"""

from __future__ import annotations

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.scene.scene import Scene
from rigidfx.scene.weights import inertial_masses
from rigidfx.step.system.rigid_motion import FREE, motions_of_parts

__all__ = ["following_energy"]


def following_energy(scene: Scene, held: Ints, jump: Array, u: Array) -> float:
    """The kinetic energy of the fitted rigid motion [J]. Collective.

    Args:
        scene: The problem.
        held: Owned dofs whose velocity jumps.
        jump: By how much, shape (held,) [m/s].
        u: Displacement at all local dofs [m].
    """
    n, parts, cells = scene.owned_nodes, scene.parts, scene.space.dofmap.list
    of_node = np.zeros(len(scene.nodal_mass), dtype=np.int64)
    of_node[cells] = parts.of_cell[: len(cells), None]
    part = of_node[:n]
    x = scene.space.tabulate_dof_coordinates()[:n] + u.reshape(-1, 3)[:n]
    motions = motions_of_parts(x, part, parts)
    nodes = held // 3
    rows = motions[nodes, held % 3]
    weighted = scene.averaging_mass[nodes, None] * rows
    fits = np.zeros((parts.count, 6, 7))  # normal equations, and their right sides
    np.add.at(fits, part[nodes], weighted[:, :, None] * np.c_[rows, jump][:, None])
    fits = np.asarray(scene.sum(fits))
    inverse = np.linalg.pinv(fits[:, :, :6], rcond=FREE, hermitian=True)
    v = (motions @ (inverse @ fits[:, :, 6:])[part])[:, :, 0]
    return 0.5 * float(scene.sum(inertial_masses(scene) @ (v * v).sum(axis=1)))

"""Rigid-body data from the mass matrix of the flexible cells, and bodies by name.

With P the rigid motions of the body's nodes about a point, M_tot = Pᵀ M P, equation (35), holds
mass, centre and inertia tensor: of the lumped masses of the body's nodes, or of the consistent
matrix of its cells, whichever the flexible cells use. Momenta are conserved only if both are the
same.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.body import BodyMotion, RigidBody
from rigidfx.errors import SceneError
from rigidfx.internal import Cells
from rigidfx.mass import Mass, mass_operator
from rigidfx.rotation import skew
from rigidfx.scene import Scene

__all__ = ["form_body"]

Array = npt.NDArray[np.float64]

THIN = 1e-10  # least over largest principal moment below which a body counts as a line


def form_body(
    scene: Scene,
    name: str,
    cells: Cells,
    nodes: npt.NDArray[np.int32],
    u: Array,
    v: Array,
    mass: float | None = None,
    inertia: npt.ArrayLike | None = None,
) -> tuple[RigidBody, BodyMotion]:
    """Make a rigid body of cells, with the momenta that its nodes have. Collective.

    Args:
        scene: The problem.
        name: Name of the body.
        cells: Its owned cells by subdomain id.
        nodes: Its owned nodes, sorted.
        u: Displacement of all owned nodes, shape (nodes, 3) [m].
        v: Velocity of all owned nodes, shape (nodes, 3) [m/s].
        mass: Mass in place of the computed one [kg].
        inertia: Inertia about the centre of mass, in the current orientation, in place of the
            computed one, shape (3, 3) [kg m²].

    Returns:
        The body and its motion, whose momenta are those of the nodes, equations (34), (39), if
        mass and inertia are the computed ones.

    Raises:
        SceneError: If its inertia tensor is singular: nodes on a line, or none.
    """
    x = scene.space.tabulate_dof_coordinates()[: scene.owned_nodes] + u
    total = np.asarray(scene.sum(np.r_[x[nodes].sum(axis=0), nodes.size]))
    if total[3] == 0:
        raise SceneError(f"Rigid body '{name}' has no nodes.")
    reference = total[:3] / total[3]
    counted = np.zeros(scene.owned_nodes, dtype=bool)
    counted[nodes] = True
    operator = mass_operator(scene, cells, counted)
    M_tot, momentum = _project(scene, operator, nodes, x[nodes] - reference, v)
    operator.destroy()
    m = np.trace(M_tot[:3, :3]) / 3  # (36)
    # M_θu = m ĉ, c the centre of mass seen from the reference point (37)
    hat = M_tot[3:, :3] / m
    c = 0.5 * np.array([hat[2, 1] - hat[1, 2], hat[0, 2] - hat[2, 0], hat[1, 0] - hat[0, 1]])
    J = M_tot[3:, 3:] + m * skew(c) @ skew(c)  # (38), Steiner
    J = 0.5 * (J + J.T)
    moments = np.linalg.eigvalsh(J)
    if not moments[0] > THIN * moments[2]:
        raise SceneError(
            f"Rigid body '{name}' has the principal moments of inertia {moments} kg m²: its nodes "
            "lie on a line, so it cannot be a body of its own. Give it more cells."
        )
    velocity = momentum[:3] / m
    spin = np.linalg.solve(J, momentum[3:] - np.cross(c, momentum[:3]))
    origin = reference + c
    body = RigidBody(
        name=name,
        cells=np.sort(np.concatenate([np.empty(0, np.int32), *cells.values()])),
        nodes=nodes,
        offsets=x[nodes] - origin,
        mass=float(m if mass is None else mass),
        inertia=J if inertia is None else np.asarray(inertia, dtype=np.float64),
        origin=origin,
    )
    return body, BodyMotion(origin.copy(), np.eye(3), velocity, spin)


def _project(
    scene: Scene, operator: Mass, nodes: npt.NDArray[np.int32], arms: Array, v: Array
) -> tuple[Array, Array]:
    """Pᵀ M P, shape (6, 6), and Pᵀ M v, shape (6,), about the reference point. Collective."""
    mode, image = fem.Function(scene.space), fem.Function(scene.space)
    n = scene.owned_nodes
    P = np.zeros((6, nodes.size, 3))
    P[:3] = np.eye(3)[:, None, :]
    P[3:] = np.cross(np.eye(3)[:, None, :], arms)
    columns = []
    for motion in (*P, v[nodes]):
        mode.x.array[:] = 0.0
        mode.x.array[: 3 * n].reshape(-1, 3)[nodes] = motion
        operator.mult(mode.x.petsc_vec, image.x.petsc_vec)
        mine = image.x.array[: 3 * n].reshape(-1, 3)[nodes]
        columns.append(np.einsum("ani,ni->a", P, mine))
    product = np.asarray(scene.sum(np.stack(columns, axis=1)))
    return product[:, :6], product[:, 6]

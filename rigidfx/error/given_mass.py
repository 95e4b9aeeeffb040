"""Mass and inertia that parts named rigid have in place of those of their cells.

Each node i of such a part gets the mass w_i φᵢᵀ A φᵢ besides, φ = (1, x/ℓ), w its own mass. The
symmetric A is chosen so that Σ w φᵀAφ φ φᵀ is the difference of the second moments, given less own:
then mass, centre and inertia of the nodes are those that are given. Nodes of a part one cell across
have no free moment along that width: there only mass and centre are exact.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import null_space

from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.rows import Rows
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.step.stepper import Stepper

__all__ = ["given_mass"]

Array = npt.NDArray[np.float64]


def given_mass(stepper: Stepper) -> Array | None:
    """Additional masses of nodes of parts of given mass or inertia. Collective.

    Args:
        stepper: Has the parts as bodies.

    Returns:
        Shape (nodes,) of the owned nodes, some of them below zero [kg]; None if nothing is given.
    """
    given = [body for body in stepper.state.bodies.of.records if body.given]
    if not given:
        return None
    out = np.zeros(stepper.scene.owned_nodes)
    for body in given:
        length = float(np.sqrt(np.trace(body.inertia) / body.mass))
        phi = np.c_[np.ones(body.nodes.size), body.offsets / length]
        change = _given(body, length) - _own(stepper, body, phi)
        out[body.nodes] += _spread(stepper.scene, body.nodes, phi, change)
    return out


def _given(body: RigidBody, length: float) -> Array:
    """Second moments Σ m φ φᵀ of a body about its centre, shape (4, 4) [kg]."""
    out: Array = np.diag([body.mass, 0.0, 0.0, 0.0])
    out[1:, 1:] = (np.trace(body.inertia) / 2 * np.eye(3) - body.inertia) / length**2
    return out


def _own(stepper: Stepper, body: RigidBody, phi: Array) -> Array:
    """The same of its cells and nodes, φᵀ M φ. Collective."""
    rows, cells = Rows(stepper.scene.space, body.nodes), stepper.forces.cells(body.cells)
    mass = mass_operator(stepper.scene, rows, cells, np.ones(len(phi), dtype=bool))
    motion, image, columns = rows.vector(), rows.vector(), []
    for column in phi.T:  # M does not couple directions
        motion.array.reshape(-1, 3)[:, 0] = column
        mass.mult(motion, image)
        columns.append(phi.T @ image.array_r.reshape(-1, 3)[:, 0])
    for item in (mass, motion, image):
        item.destroy()
    return np.asarray(stepper.scene.sum(np.stack(columns, axis=1)))


def _spread(scene: Scene, nodes: npt.NDArray[np.int32], phi: Array, change: Array) -> Array:
    """Masses of nodes with given second moments, shape (nodes,) [kg]. Collective."""
    w, (i, j) = scene.nodal_mass[nodes], np.triu_indices(4)
    products = phi[:, i] * phi[:, j]
    gram = np.asarray(scene.sum(products.T @ (w[:, None] * products)))
    first, wanted = len(change), change[i, j]  # mass and centre: exact, the rest as far as can be
    free = null_space(gram[:first])
    a = np.linalg.pinv(gram[:first]) @ wanted[:first]
    a += free @ (np.linalg.pinv(gram[first:] @ free) @ (wanted[first:] - gram[first:] @ a))
    return np.asarray(w * (products @ a))

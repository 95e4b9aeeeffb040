"""Mass and inertia that parts named rigid have in place of those of their cells.

Each node i of such a part gets the mass w_i φᵢᵀ A φᵢ besides, φ = (1, x/ℓ), w its own mass. The
symmetric A is chosen so that Σ w φᵀAφ φ φᵀ is the difference of the second moments, given less own:
then mass, centre and inertia of the nodes are those that are given.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.scene.scene import Scene
from rigidfx.step.stepper import Stepper
from rigidfx.switch.mass_properties import mass_properties

__all__ = ["given_mass"]

Array = npt.NDArray[np.float64]

PAIRS = np.triu_indices(4)  # entries of a symmetric matrix of second moments


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
    scene, x = stepper.scene, np.zeros((stepper.scene.owned_nodes, 3))
    out = np.zeros(len(x))
    for body in given:
        x[body.nodes] = body.offsets
        cells = stepper.forces.cells(body.cells)
        own = mass_properties(scene, cells, body.nodes, x, np.zeros_like(x))
        length = float(np.sqrt(np.trace(own.inertia) / own.mass))
        change = _second(body.mass, body.inertia, length) - _second(own.mass, own.inertia, length)
        offsets = np.asarray(body.offsets / length, dtype=np.float64)
        out[body.nodes] += _spread(scene, body.nodes, offsets, change)
    return out


def _second(mass: float, inertia: Array, length: float) -> Array:
    """Second moments Σ m φ φᵀ of a body about its centre, shape (4, 4) [kg]."""
    out: Array = np.diag([mass, 0.0, 0.0, 0.0])
    out[1:, 1:] = (np.trace(inertia) / 2 * np.eye(3) - inertia) / length**2
    return out


def _spread(scene: Scene, nodes: npt.NDArray[np.int32], x: Array, change: Array) -> Array:
    """Masses of nodes at x with given second moments, shape (nodes,) [kg]. Collective."""
    w = scene.nodal_mass[nodes]
    phi = np.c_[np.ones(len(x)), x]
    products = phi[:, PAIRS[0]] * phi[:, PAIRS[1]]
    gram = np.asarray(scene.sum(products.T @ (w[:, None] * products)))
    return np.asarray(w * (products @ np.linalg.lstsq(gram, change[PAIRS], rcond=None)[0]))

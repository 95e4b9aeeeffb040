"""Freeze cells as a rigid body, and give everything back: equations (34)-(43).

At the freeze the body takes over the momenta of its nodes, by one 6×6 system. Their difference
velocities from its rigid motion (40) and its deformed shape are kept in its frame; so its strain
energy is kept as well, and the kinetic energy is that of the rigid motion plus that of the
difference, exactly, because the latter has no momenta. At the release the nodes get

    v = ṙ + ω × R V + R ΔV                                                                  (41)

and momenta and total energy are what they were, however the body moved in between (42), (43). Any
change of a body (growth, merging, loss of some cells) is a release of all bodies concerned and a
new freeze in the same instant; handing ΔV to some of the nodes only would break all three balances.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.body import BodyMotion, Frozen, RigidBody
from rigidfx.inertia import MassProperties, mass_properties
from rigidfx.internal import InternalForces
from rigidfx.scene import Scene
from rigidfx.state import State

__all__ = ["freeze", "release"]

Array = npt.NDArray[np.float64]
Bodies = Sequence[tuple[RigidBody, BodyMotion]]


def freeze(
    scene: Scene,
    forces: InternalForces,
    state: State,
    cells: npt.NDArray[np.int32],
    nodes: npt.NDArray[np.int32],
    name: str,
    number: int,
    named: tuple[str, ...] = (),
) -> tuple[RigidBody, BodyMotion] | MassProperties:
    """Make a rigid body of cells in their present shape. Collective.

    Args:
        scene: The problem.
        forces: Internal forces, which know the stored energy.
        state: Displacement and velocity, up to date at the nodes.
        cells: Owned cells, sorted.
        nodes: All owned nodes of these cells, sorted.
        name: Name of the body.
        number: Its number.
        named: Sets of cells in it that are rigid always.

    Returns:
        The body and its motion; its mass properties, if they are singular.
    """
    n = scene.owned_nodes
    u, v = (f.x.array[: 3 * n].reshape(-1, 3) for f in (state.u, state.v))
    x = state.X[:n] + u
    forces.u1.x.array[:] = state.u.x.array
    by_material = forces.cells(cells)
    p = mass_properties(scene, by_material, nodes, x, v)
    if p.singular:
        return p
    motion = BodyMotion(p.centre.copy(), np.eye(3), p.velocity, p.spin)
    offsets = x[nodes] - p.centre
    difference = v[nodes] - motion.velocities(offsets)
    local = [
        float(fem.assemble_scalar(forces.bind_energy(by_material))),
        0.5 * float(scene.nodal_mass[nodes] @ (difference**2).sum(axis=1)),
        cells.size,
    ]
    strain, vibration, size = scene.sum(local)
    body = RigidBody(
        name=name,
        cells=cells,
        nodes=nodes,
        offsets=offsets,
        mass=p.mass,
        inertia=p.inertia,
        origin=p.centre,
        number=number,
        size=int(size),
        named=named,
        frozen=Frozen(nodes, difference, float(strain), float(vibration)),
    )
    return body, motion


def release(state: State, bodies: Bodies) -> None:
    """Give the nodes of bodies their displacement, and their velocity (41). Collective.

    Args:
        state: Displacement and velocity, changed at these nodes.
        bodies: The bodies, with their present motions.
    """
    u, v = (f.x.array.reshape(-1, 3) for f in (state.u, state.v))
    for body, motion in bodies:
        u[body.nodes] = motion.positions(body.offsets) - state.X[body.nodes]
        v[body.nodes] = motion.velocities(body.offsets)
        v[body.frozen.nodes] += body.frozen.velocities @ motion.R.T
    state.u.x.scatter_forward()
    state.v.x.scatter_forward()

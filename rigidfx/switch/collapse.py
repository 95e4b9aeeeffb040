"""A body with shapes as the rigid body in its present shape, by which it is released.

That body has its momenta and its energy. It keeps the velocities with which the shapes change, as a
frozen body keeps vibrations, so that the release of rigid bodies (`exchange`) gives all back. The
strain energy of its cells is not U(q), which is of second order: the difference is taken from these
velocities, as far as they have it, or given to them.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

import numpy as np

from rigidfx.base.types import Array
from rigidfx.decide.bodies import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, Frozen
from rigidfx.mechanics.rigid_motions import fitted_motion, rigid_motions
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.switch.exchange import freeze


def collapse(
    scene: Scene, forces: InternalForces, state: State, numbers: Set[int], scales: bool
) -> None:
    """Make bodies with shapes rigid as they are deformed. Collective.

    Args:
        scene: The problem.
        forces: Internal forces, which know the strain energy.
        state: Its bodies are replaced.
        numbers: Of bodies that are about to be released; no support holds nodes of those found.
        scales: Whether the release scales what bodies keep so that it has the energy that they
            keep; it gives it back as it is otherwise.
    """
    order = [body.data.number for body in state.bodies]
    shaped = {b.data.number for b in state.bodies if b.data.shapes is not None} & numbers
    if not shaped:
        return
    left = {b.data.number: b for b in state.bodies if b.data.number not in shaped}
    velocity = state.v.x.array.copy()
    for body in state.take_out(shaped):
        moving = velocity.copy()
        moving.reshape(-1, 3)[body.data.nodes] = body.velocities
        state.move(moving)
        left[body.data.number] = rigid = _rigid(scene, forces, state, body)
        if not scales:
            kept = _with_energy(scene, rigid)
            left[body.data.number] = replace(rigid, data=replace(rigid.data, frozen=kept))
    state.move(velocity)
    state.group(Bodies.of_each(left[number] for number in order))


def _rigid(scene: Scene, forces: InternalForces, state: State, body: Body) -> Body:
    """The rigid body with a body's momenta and energy. Collective."""
    data, alone = body.data, Bodies.of_each([body])
    what = PlannedBody(data.cells, data.nodes, data.name, data.number, data.named)
    found = freeze(scene, forces, state, what)
    assert found is not None  # its cells have been a body before
    if data.shapes is not None and data.shapes.drift is None:  # no support holds its frame
        W = np.linalg.solve(found.data.inertia, alone.angular_momentum[0])
        found = replace(found, motion=replace(found.motion, angular_velocity_body=W))
    kept = np.zeros((scene.owned_nodes, 3))
    kept[data.frozen.nodes] = data.frozen.velocities @ body.motion.R.T
    kept[data.nodes] += found.data.frozen.velocities
    nodes = np.flatnonzero(kept.any(axis=1)).astype(np.int32)
    whole = alone.kinetic_of_each[0] + alone.strain_of_each[0] + data.frozen.vibration
    strain = found.data.frozen.strain
    vibration = float(whole - strain - Bodies.of_each([found]).kinetic_of_each[0])
    frozen = Frozen(nodes, kept[nodes], strain, vibration)
    return replace(found, data=replace(found.data, frozen=frozen))


def _with_energy(scene: Scene, body: Body) -> Frozen:
    """What a body keeps, with the energy that it keeps, where masses are lumped. Collective."""
    frozen, data = body.data.frozen, body.data
    everywhere = np.zeros((scene.owned_nodes, 3))
    everywhere[frozen.nodes] = frozen.velocities
    v: Array = everywhere[data.nodes]
    m = scene.nodal_mass[data.nodes, None]
    rows = rigid_motions(data.offsets, data.length).reshape(-1, 6)
    # Without angular momentum about the body as it is now.
    motion = fitted_motion(rows, v.reshape(-1, 1), scene.sum, np.repeat(m, 3, axis=0))
    v = v - (rows @ motion).reshape(v.shape)
    kinetic = 0.5 * float(scene.sum((m * v * v).sum()))
    vibration = max(frozen.vibration, 0.0) if kinetic > 0 else 0.0
    part = vibration / kinetic if kinetic > 0 else 1.0
    return Frozen(data.nodes, np.sqrt(part) * v, frozen.strain, vibration)

"""Freeze cells as a rigid body, and release them: equations (34)-(43).

At the freeze a body takes over the momenta of its nodes, by one 6×6 system. It keeps its deformed
shape, and hence its strain energy, and in its frame the difference velocities (40) of its nodes
from the rigid motion. These have no momenta, so the kinetic energy is exactly that of the rigid
motion plus theirs. At the release the nodes get

    v = ṙ + ω × R V + R ΔV                                                                  (41)

and momenta and total energy do not change, however the body moved in between (42), (43). Any change
of a body (growth, merging, loss of some cells) is a release of all bodies concerned and a new
freeze in the same instant; handing ΔV to some of the nodes only would break all three balances.

A body with shapes is released as the rigid body in its present shape. That body has its momenta and
its energy. It keeps the velocities with which the shapes change, as a frozen body keeps vibrations,
so that the release gives all back. The strain energy of its cells is not U(q), which is of second
order: the difference is taken from these velocities, as far as they have it, or given to them.

This holds for a lumped mass; with a consistent one velocities inside a body and outside are coupled
by the mass, see `consistent_exchange`.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from dolfinx import fem

from rigidfx.base.types import Array, Bools
from rigidfx.decide.bodies import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion, Frozen, RigidBody
from rigidfx.mechanics.rigid_motions import fitted_motion, rigid_motions
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.switch.mass_properties import excess_of_lumping, mass_properties


class Works(NamedTuple):
    """Work of the impulses that keep given velocities at a switch [J].

    Attributes:
        supports: Of supports.
        motors: Of motors of given motion.
    """

    supports: float
    motors: float

    @property
    def whole(self) -> float:
        """Of both [J]."""
        return self.supports + self.motors


def freeze(scene: Scene, forces: InternalForces, state: State, what: PlannedBody) -> Body | None:
    """Make a body of planned cells, unless their inertia is singular; see `release`. Collective.

    It takes over rigid faces among its nodes, whose displacement and velocity are up to date.
    One of shapes that gains or loses cells keeps the energy of its expansion: what velocities could
    not take of its difference to that of the cells stays with the strain energy.
    """
    n = scene.owned_nodes
    u, v = (f.x.array[: 3 * n].reshape(-1, 3) for f in (state.u, state.v))
    x = state.X[:n] + u
    cells = forces.cells(what.cells)
    p = mass_properties(scene, cells, what.nodes, x, v)
    if p.singular:
        return None
    motion = BodyMotion(p.centre.copy(), np.eye(3), p.velocity, p.angular_velocity)
    offsets = x[what.nodes] - p.centre
    strain = float(fem.assemble_scalar(forces.bind_energy(cells)))
    strain, size = scene.sum([strain, what.cells.size])
    excess: Array = np.zeros((3, 3))
    if scene.mass == "lumped":
        everywhere = state.X + state.u.x.array.reshape(-1, 3)
        excess = excess_of_lumping(scene, what.cells, everywhere)
    body = RigidBody(
        name=what.name,
        cells=what.cells,
        nodes=what.nodes,
        offsets=offsets,
        displacement=u[what.nodes],
        mass=p.mass,
        inertia=p.inertia,
        origin=p.centre,
        number=what.number,
        size=int(size),
        named=what.named,
        excess=excess,
        frozen=Frozen(
            what.nodes,
            v[what.nodes] - motion.velocities(offsets),
            float(strain),
            max(p.kinetic - p.rigid, 0.0),
        ),
    )
    return Body(body, motion)


class Exchange:
    """Moves energy and momenta between nodes and bodies; both ways change the state only.

    Each node has its own mass here, so that nodes outside a body are not concerned.

    Attributes:
        shape: Gives a body that was found its shapes; None if it stays rigid.
        scales: Whether a release scales kept velocities so that they have the energy kept.
    """

    scales = False

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Keep the problem."""
        self._scene, self._forces = scene, forces
        self.shape: Callable[[Body], Body] | None = None
        # Energy that the velocities of bodies released last lack, and numbers of those with shapes.
        self._owed, self._shaped = 0.0, set[int]()

    def release(self, state: State, numbers: Set[int], prescribed: Bools) -> Works:
        """Make bodies of a state flexible; the work of supports and motors. Collective.

        Supports prescribe some owned dofs.
        """
        self._owed, self._shaped = 0.0, set()
        if not numbers:
            return Works(0.0, 0.0)
        self._collapse(state, numbers)
        gone = state.take_out(numbers)
        velocity = state.v.x.array.copy()
        v = velocity.reshape(-1, 3)
        for body in gone:
            frozen = body.data.frozen
            v[body.data.nodes] = body.velocities
            v[frozen.nodes] += frozen.velocities @ body.motion.R.T
        state.move(velocity)
        return Works(0.0, 0.0)

    def _collapse(self, state: State, numbers: Set[int]) -> None:
        """Make those of some bodies that have shapes rigid as they are deformed. Collective."""
        order = [body.data.number for body in state.bodies]
        shaped = {b.data.number for b in state.bodies if b.data.shapes is not None} & numbers
        self._shaped = shaped
        if not shaped:
            return
        left = {b.data.number: b for b in state.bodies if b.data.number not in shaped}
        velocity = state.v.x.array.copy()
        for body in state.take_out(shaped):
            moving = velocity.copy()
            moving.reshape(-1, 3)[body.data.nodes] = body.velocities
            state.move(moving)
            rigid = _rigid(self._scene, self._forces, state, body)
            if not self.scales:
                wanted, rigid = rigid.data.frozen.vibration, _with_energy(self._scene, rigid)
                self._owed += wanted - rigid.data.frozen.vibration
            left[body.data.number] = rigid
        state.move(velocity)
        state.group(Bodies.of_each(left[number] for number in order))

    def freeze(self, state: State, what: PlannedBody, prescribed: Bools) -> Works:
        """Make a body of cells, unless their inertia is singular. Collective.

        One of shapes that gains or loses cells keeps the energy of its expansion: what velocities
        could not take of its difference to that of the cells stays with the strain energy.

        Args:
            state: Gains the body, which takes over rigid faces among its nodes. Displacement and
                velocity of its nodes are up to date.
            what: Cells and nodes.
            prescribed: For each owned dof, whether a support prescribes it.

        Returns:
            Work of supports and motors.
        """
        body = freeze(self._scene, self._forces, state, what)
        if body is None:
            return Works(0.0, 0.0)
        if what.number in self._shaped:
            frozen = replace(body.data.frozen, strain=body.data.frozen.strain + self._owed)
            body, self._owed = replace(body, data=replace(body.data, frozen=frozen)), 0.0
        return self._include(state, body if self.shape is None else self.shape(body), prescribed)

    def _include(self, state: State, body: Body, prescribed: Bools) -> Works:
        """Add a body with the momenta of its nodes. Collective."""
        state.group(Bodies.of_each([*state.bodies, body]))
        return Works(0.0, 0.0)

    def settle(self, state: State, division: Division, prescribed: Bools) -> None:
        """Settle the bodies of a division in a state, momenta and energy kept. Collective.

        Parts named rigid that it has not had have the momenta of their own mass.
        """
        state.group(division.bodies)


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


def _with_energy(scene: Scene, body: Body) -> Body:
    """A body that keeps velocities of the energy that it keeps, for lumped masses. Collective."""
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
    kept = Frozen(data.nodes, np.sqrt(part) * v, frozen.strain, vibration)
    return replace(body, data=replace(data, frozen=kept))

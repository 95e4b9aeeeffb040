"""Freeze cells as a rigid body, and release them: equations (34)-(43).

At the freeze a body takes over the momenta of its nodes, by one 6×6 system. It keeps its deformed
shape, and hence its strain energy, and in its frame the difference velocities (40) of its nodes
from the rigid motion. These have no momenta, so the kinetic energy is exactly that of the rigid
motion plus theirs. At the release the nodes get

    v = ṙ + ω × R V + R ΔV                                                                  (41)

and momenta and total energy do not change, however the body moved in between (42), (43). Any change
of a body (growth, merging, loss of some cells) is a release of all bodies concerned and a new
freeze in the same instant; handing ΔV to some of the nodes only would break all three balances.

This holds for a lumped mass; with a consistent one velocities inside a body and outside are coupled
by the mass, see `consistent_exchange`.
"""

from __future__ import annotations

from collections.abc import Callable, Set
from typing import NamedTuple

import numpy as np
from dolfinx import fem

from rigidfx.base.types import Array, Bools
from rigidfx.decide.bodies import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, BodyMotion, Frozen, RigidBody
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
    """A rigid body of cells in their present shape, with the momenta of its own mass. Collective.

    None if its inertia is singular. The state is up to date at its nodes.
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
    turning = p.angular_velocity @ p.inertia @ p.angular_velocity
    excess: Array = np.zeros((3, 3))
    if scene.mass == "lumped":
        everywhere = state.X + state.u.x.array.reshape(-1, 3)
        excess = excess_of_lumping(scene, what.cells, everywhere)
    rigid = 0.5 * float(p.mass * p.velocity @ p.velocity + turning)
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
            max(p.kinetic - rigid, 0.0),
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

    def release(self, state: State, numbers: Set[int], prescribed: Bools) -> Works:
        """Make bodies flexible. Collective.

        Args:
            state: Loses these bodies.
            numbers: Numbers of bodies.
            prescribed: For each owned dof, whether a support prescribes it.

        Returns:
            Work of supports and motors.
        """
        if not numbers:
            return Works(0.0, 0.0)
        gone = state.take_out(numbers)
        velocity = state.v.x.array.copy()
        v = velocity.reshape(-1, 3)
        for body in gone:
            frozen = body.data.frozen
            v[body.data.nodes] = body.velocities
            v[frozen.nodes] += frozen.velocities @ body.motion.R.T
        state.move(velocity)
        return Works(0.0, 0.0)

    def freeze(self, state: State, what: PlannedBody, prescribed: Bools) -> Works:
        """Make a body of cells, unless their inertia is singular. Collective.

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
        return self._include(state, body if self.shape is None else self.shape(body), prescribed)

    def _include(self, state: State, body: Body, prescribed: Bools) -> Works:
        """Add a body with the momenta of its nodes. Collective."""
        state.group(Bodies.of_each([*state.bodies, body]))
        return Works(0.0, 0.0)

    def settle(self, state: State, division: Division, prescribed: Bools) -> None:
        """Settle the bodies of a division, momenta and energy kept. Collective.

        Args:
            state: Gets these bodies. Those of them that it has not had, parts that are named
                rigid, have the momenta of their own mass.
            division: The division.
            prescribed: For each owned dof, whether a support prescribes it.
        """
        state.group(division.bodies)

"""Freeze cells as a rigid body, and release them: equations (34)-(43), exact in energy and momenta.

docs/theory.md, section 5, has lumped and consistent masses, docs/theory/shapes.md bodies with
shapes. Any change of a body (growth, merging, loss of some cells) is a release of all bodies
concerned and a new freeze in the same instant; handing ΔV to some of the nodes only would break all
three balances. The flexible side of an interface gets the velocity of the body; otherwise the
difference would alternate.
"""

from collections.abc import Callable, Sequence, Set
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.decide.bodies import PlannedBody
from rigidfx.effects import Joint, Motor, PointMass
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.growth.found_bodies import Shift
from rigidfx.inventory.inventory import with_faces
from rigidfx.inventory.mass_properties import freeze
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, Frozen
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.switch.projected_velocities import Field, Present, RigidFields, WholeMass

NEGLIGIBLE = 1e-15  # of the largest: difference velocities that need not be kept
ROUNDING = 1e-13  # of the energy, too little to scale a field by; of velocities at an interface


class Works(NamedTuple):
    """Work of the impulses that keep given velocities at a switch [J]."""

    supports: float  # of supports
    motors: float  # of motors of given motion

    @property
    def whole(self) -> float:
        """Of both [J]."""
        return self.supports + self.motors


class Exchange:
    """Moves energy and momenta between nodes and bodies; both ways change the state only.

    Attributes:
        shape: Gives a body that was found its shapes; None if it stays rigid.
        leave: How nodes move where bodies leave these; None if they stay.
        joined: Whether joints, or masses that bodies carry, couple velocities.
        motors: Motors that act and prescribe a motion, whose speed velocities after a switch have.
        dt: See `Motor.speed_at`.
    """

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        self._scene, self._forces = scene, forces
        self.shape: Callable[[Body], Body] | None = None
        self.leave: Callable[[Sequence[Body]], Shift | None] | None = None
        carried = any(effect.is_carried for effect in scene.named(PointMass))
        self.joined = carried or bool(scene.named(Joint))
        self._mass = WholeMass(scene, forces)
        self.motors: tuple[Motor, ...] = ()
        self.dt = 0.0
        # Energy that the velocities of bodies released last lack, and numbers of those with shapes.
        self._owed, self._shaped = 0.0, set[int]()

    def release(self, state: State, numbers: Set[int], prescribed: Bools) -> Works:
        """Make bodies flexible; the work of supports, at owned dofs, and of motors. Collective."""
        self._owed, self._shaped = 0.0, set()
        if not numbers:
            return Works(0.0, 0.0)
        self._collapse(state, numbers)
        present = self._mass.present(state)
        before = self._fields(state, prescribed, present)
        of_given = before.given_momenta(present.bodies)
        row = {body.number: k for k, body in enumerate(state.bodies.of.records)}
        gone = state.take_out(numbers)
        faces = with_faces(self._scene, self._forces, state)
        after = self._fields(state, prescribed, present)
        # Bodies before and after: those that stay, and rigid faces that are bodies again.
        records = enumerate(state.bodies.of.records)
        pairs = [(k, row[body.number]) for k, body in records if body.number in row]
        now, was = np.reshape(pairs, (-1, 2)).astype(int).T
        none = np.zeros_like(state.bodies.rates)
        of_staying, rigid_bodies, wide = none.copy(), none.copy(), none.shape[1]
        of_staying[now] = of_given[was, :wide]
        held = present.nodal[prescribed]
        merged = after.project(present.momenta, of_staying, held)
        # The kept field, rotated with its bodies, and the difference of the two velocities that the
        # interface has had, which shapes have kept already, as a field that is possible now and
        # adds no momenta. The flexible cells have the difference before.
        kept = np.zeros((self._scene.owned_nodes, 3))
        for body in gone:
            if body.data.number not in self._shaped:
                kept[body.data.nodes] += present.difference[body.data.nodes]
            kept[body.data.frozen.nodes] += _kept(body)
        at_rest = np.zeros_like(held)
        momenta = after.momenta(kept.reshape(-1)) - present.differing
        possible = after.project(momenta, none, at_rest, False)
        own = np.zeros_like(of_given)
        own[was, :wide] = after.given_momenta(possible.bodies)[now]
        rigid = before.project(before.momenta(possible.nodal), own, at_rest, False)
        rigid_bodies[now] = rigid.bodies[was, :wide]
        mode = possible.plus(-1.0, Field(rigid.nodal, rigid_bodies))
        work = Works(
            present.work(prescribed, after.momenta(merged.nodal) - present.momenta),
            after.work(merged, held),
        )
        # Impulses that hold the difference are those that its rigid part has needed, reversed.
        of_mode = Works(
            present.work(prescribed, after.momenta(mode.nodal)), -before.work(rigid, held)
        )
        wanted = present.energy + work.whole + sum(body.data.frozen.vibration for body in gone)
        missing = wanted - 0.5 * after.product(merged, merged)
        scale = 1.0
        if abs(missing) > ROUNDING * abs(wanted):
            mixed = after.product(merged, mode) - of_mode.whole
            square = after.product(mode, mode)
            scale = _scale(square, mixed, missing)
            self._owed = missing - scale * (mixed + 0.5 * scale * square)
        _take(state, merged.plus(scale, mode))
        if faces:  # with the velocities of their nodes
            state.take_out(faces)
            with_faces(self._scene, self._forces, state)
        free(before, after)
        return Works(*(a + scale * b for a, b in zip(work, of_mode, strict=True)))

    def _collapse(self, state: State, numbers: Set[int]) -> None:
        """Make those of some bodies that have shapes rigid as they are deformed. Collective."""
        order = [body.data.number for body in state.bodies]
        shaped = {b.data.number for b in state.bodies if b.data.shapes is not None} & numbers
        self._shaped = shaped
        if not shaped:
            return
        velocity = state.v.x.array.copy()
        going = [body for body in state.bodies if body.data.number in shaped]
        shift = None if self.leave is None else self.leave(going)
        if shift is not None:
            state.group(shift.bodies)
            going = [body for body in state.bodies if body.data.number in shaped]
        left = {b.data.number: b for b in state.bodies if b.data.number not in shaped}
        state.take_out(shaped)
        turned: Array = np.zeros(3)
        energy = 0.0  # what others have gained: the first body gives it
        if shift is not None:
            state.shift(np.arange(shift.d.size), shift.d.reshape(-1))
            energy, turned = shift.energy, shift.angular_momentum
        for body in going:
            moving = velocity.copy()
            moving.reshape(-1, 3)[body.data.nodes] = body.velocities
            state.move(moving)
            left[body.data.number] = self._rigid(state, body, energy, turned)
            energy, turned = 0.0, np.zeros(3)
        state.move(velocity)
        state.group(Bodies.of_each(left[number] for number in order))

    def _rigid(self, state: State, body: Body, gained: float, turned: Array) -> Body:
        """The rigid body with a body's momenta and energy less what others have gained. Collective.

        That is energy [J], and angular momentum as it has `turned` nodes, shape (3,) [kg m²/s].
        """
        data, alone = body.data, Bodies.of_each([body])
        what = PlannedBody(data.cells, data.nodes, data.name, data.number, data.named)
        found = freeze(self._scene, self._forces, state, what)
        assert found is not None  # its cells have been a body before
        if data.shapes is not None and data.shapes.drift is None:  # no support holds its frame
            # As much about a centre that has moved, less what nodes of other cells have gained.
            about = np.cross(body.motion.r - found.motion.r, alone.momentum[0]) - turned
            W = np.linalg.solve(found.data.inertia, alone.angular_momentum[0] + about)
            found = replace(found, motion=replace(found.motion, angular_velocity_body=W))
        kept = np.zeros((self._scene.owned_nodes, 3))
        kept[data.frozen.nodes] = _kept(body)
        kept[data.nodes] += found.data.frozen.velocities
        nodes = np.flatnonzero(kept.any(axis=1)).astype(np.int32)
        whole = alone.kinetic_of_each[0] + alone.strain_of_each[0] + data.frozen.vibration - gained
        strain = found.data.frozen.strain
        vibration = float(whole - strain - Bodies.of_each([found]).kinetic_of_each[0])
        frozen = Frozen(nodes, kept[nodes], strain, vibration)
        return replace(found, data=replace(found.data, frozen=frozen))

    def freeze(self, state: State, what: PlannedBody, prescribed: Bools) -> Works:
        """Make a body of planned cells; the work of supports and motors. Collective.

        The state gains the body, which takes over rigid faces among its nodes, unless its inertia
        is singular. One of shapes that gains or loses cells keeps the energy of its expansion: what
        velocities could not take of its difference to that of the cells stays with the strain
        energy. Supports prescribe some owned dofs.
        """
        body = freeze(self._scene, self._forces, state, what)
        if body is None:
            return Works(0.0, 0.0)
        if what.number in self._shaped:
            frozen = replace(body.data.frozen, strain=body.data.frozen.strain + self._owed)
            body, self._owed = replace(body, data=replace(body.data, frozen=frozen)), 0.0
        body = body if self.shape is None else self.shape(body)
        return self._include(state, body, prescribed)

    def settle(self, state: State, division: Division, prescribed: Bools) -> None:
        """Settle the bodies of a division in a state, momenta and energy kept. Collective.

        Parts named rigid that it has not had have the momenta of their own mass.
        """
        there = {body.data.number for body in state.bodies}
        new = [body for body in division.bodies if body.data.number not in there]
        lumped = self._scene.mass == "lumped"
        if lumped or not new or self._continuous(state, division, new):
            state.group(division.bodies)
            return
        # Those of given mass all at once: their momenta are known, and not those of their cells.
        # They keep nothing, as they are never released.
        given = {body.data.number for body in new if body.data.given}
        first = [b for b in division.bodies if b.data.number in there | given]
        state.group(Bodies.of_each(first))
        if given:
            self._projected(self._mass.present(state), state, prescribed)
        for body in new:
            if not body.data.given:
                self._include(state, body, prescribed, named=True)
        settled = {body.data.number: body for body in state.bodies}
        state.group(Bodies.of_each(settled[b.number] for b in division.bodies.of.records))

    def _continuous(self, state: State, division: Division, bodies: list[Body]) -> bool:
        """Whether flexible cells and bodies have one velocity where they meet. Collective."""
        meet = nodes_of(self._scene, division.flexible)
        gap = state.gap(bodies, [np.flatnonzero(meet[body.data.nodes]) for body in bodies])
        largest = float(np.abs(state.v.x.array).max(initial=0.0))
        gap, largest = np.max(self._scene.comm.allgather((gap, largest)), axis=0)
        return bool(gap <= ROUNDING * largest)

    def _include(self, state: State, body: Body, prescribed: Bools, named: bool = False) -> Works:
        """Add a body with the momenta of its nodes; a named one keeps all work. Collective."""
        present = self._mass.present(state)
        faces = set() if named else _faces_within(self._scene, state, body.data.nodes)
        taken = [own for own in state.bodies if own.data.number in faces]
        state.group(Bodies.of_each(own for own in state.bodies if own.data.number not in faces))
        others = list(state.bodies)
        state.group(Bodies.of_each([*others, body]))
        fields, held = self._fields(state, prescribed, present), present.nodal[prescribed]
        of_given = fields.given_momenta(state.bodies.rates)
        of_given[-1] = 0.0
        new = fields.project(present.momenta, of_given, held)
        lost: Array = np.reshape(present.nodal - new.nodal, (-1, 3))
        for own in taken:
            lost[own.data.frozen.nodes] += _kept(own)
        size: Array = np.sqrt((lost**2).sum(axis=1))
        most = self._scene.comm.allreduce(float(size.max(initial=0.0)), op=MPI.MAX)
        nodes = np.flatnonzero(size > NEGLIGIBLE * most).astype(np.int32)
        work = Works(0.0, 0.0)
        if not named:
            gained = fields.momenta(new.nodal) - present.momenta
            work = Works(present.work(prescribed, gained), fields.work(new, held))
        energy = present.energy + work.whole - 0.5 * fields.product(new, new)
        energy += sum(own.data.frozen.vibration for own in taken)
        frozen = Frozen(nodes, lost[nodes], body.data.frozen.strain, energy)
        if named and body.data.shapes is not None:  # it is never released
            frozen = body.data.frozen
        body = replace(body, data=replace(body.data, frozen=frozen))
        state.group(Bodies.of_each([*others, body]))
        _take(state, new)
        fields.destroy()
        return work

    def close(self, state: State, prescribed: Bools) -> float:
        """Impulses that close joints; the energy gained, zero if rounding [J]. Collective."""
        present = self._mass.present(state)
        gained = self._projected(present, state, prescribed) - present.energy
        return gained if abs(gained) > ROUNDING * present.energy else 0.0

    def _projected(self, present: Present, state: State, prescribed: Bools) -> float:
        """Give a state the velocities that are possible with its bodies; its energy. Collective."""
        fields = self._fields(state, prescribed, present)
        own = fields.given_momenta(present.bodies)
        new = fields.project(present.momenta, own, present.nodal[prescribed])
        energy = 0.5 * fields.product(new, new)
        _take(state, new)
        fields.destroy()
        return energy

    def _fields(self, state: State, prescribed: Bools, present: Present) -> RigidFields:
        return RigidFields(self._scene, state, prescribed, present.mass, self.motors, self.dt)


def _kept(body: Body) -> Array:
    """Velocities of vibration that a body keeps, as they are turned now [m/s]."""
    return np.asarray(body.data.frozen.velocities @ body.motion.R.T)


def _faces_within(scene: Scene, state: State, nodes: Indices) -> set[int]:
    """Numbers of the rigid faces that have some of these nodes. Collective."""
    faces = [body for body in state.bodies.of.records if body.is_face]
    if not faces:
        return set()
    inside = scene.sum([np.intersect1d(face.nodes, nodes).size for face in faces])
    return {face.number for face, some in zip(faces, inside, strict=True) if some > 0}


def _take(state: State, field: Field) -> None:
    """Make a field the state's velocity. Collective."""
    state.move(field.nodal)
    bodies = state.bodies.with_rates(field.bodies)
    if (shapes := bodies.of.shapes) is not None:  # centres in frames that are held follow shapes
        drifting = np.einsum("bij,bkj,bk->bi", bodies.R, shapes.drift, bodies.q_rate)
        bodies = bodies.moving(bodies.velocity + drifting, bodies.angular_velocity_body)
    state.group(bodies)


def _scale(square: float, mixed: float, missing: float) -> float:
    """The s > 0 nearest to 1 with ½ s² square + s mixed = missing, in J; 0 if there is none."""
    discriminant = mixed**2 + 2 * square * missing
    if not (square > 0.0 and discriminant >= 0.0):
        return 0.0
    root = np.sqrt(discriminant)
    found = [float(s) for s in ((root - mixed) / square, (-root - mixed) / square) if s > 0.0]
    return min(found, key=lambda s: abs(s - 1.0), default=0.0)

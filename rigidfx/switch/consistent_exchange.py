"""Freeze and release with a consistent mass: exact in energy and momenta, beyond the paper's (6.2).

The mass couples a body's nodes with the flexible ones round it. So no exchange by the body's nodes
alone, such as (34) and (41), keeps all balances. Here velocities are projected, in the metric of
the mass, on the fields P y that are rigid in the bodies:

    Pᵀ M P y = Pᵀ p,    p the momenta of all nodes.

The removed part has no momenta, since rigid motions of the whole are among the P y, and its energy
is exactly the difference. The new body keeps both. Moving supports do work meanwhile: their nodes
keep their velocity v_s by an impulse, the change of (M v)_s, and motors of given speed theirs by
impulses Λ of their joints. The flexible side of an interface,
which has a velocity of its own between switches, gets that of the body; otherwise the difference
would alternate from step to step. At a release the kept field is rotated with the body and brought
into the range of the P that is valid then. It is made orthogonal to the former range, so that it
adds no momenta, and scaled to restore the energy.

With joints, all of this holds for a lumped mass, too, and P y are the fields that also keep joints
closed: otherwise a freeze would give their two sides different velocities.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array, Bools, Indices
from rigidfx.coupling.dof_layout import nodes_of, split
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Motor
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, Frozen, RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.division import Division
from rigidfx.switch.exchange import Exchange, Works
from rigidfx.switch.faces import with_faces
from rigidfx.switch.projected_velocities import Field, RigidFields

NEGLIGIBLE = 1e-15  # of the largest: difference velocities that need not be kept
CONTINUOUS = 1e-13  # of the largest: difference of velocities at an interface that is only rounding
ROUNDING = 1e-13  # of the energy: what is too little to find the scale of a field by


class Present:
    """The velocities as they are, two of them where bodies meet flexible cells.

    Attributes:
        mass: M of all cells but those in bodies whose mass is given.
        nodal: Velocity of all owned dofs, the bodies' at their nodes [m/s].
        difference: At each owned node of an interface, the flexible cells' velocity less the
            body's; zero elsewhere, shape (nodes, 3) [m/s].
        bodies: Velocity of the centre and ℓω of each body, shape (bodies, 6) [m/s].
        momenta: Momenta at all owned dofs, but those of masses that are given [kg m/s].
        energy: Kinetic energy [J].
    """

    def __init__(self, scene: Scene, forces: InternalForces, state: State, mass: PETSc.Mat) -> None:
        """Add up momenta and energy. Collective."""
        self.mass = mass
        self.nodal: Array = state.v.x.array[: 3 * scene.owned_nodes].copy()
        outside = self.nodal.copy()
        for moving in state.bodies:
            self.nodal.reshape(-1, 3)[moving.data.nodes] = moving.velocities
        every = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        inside = np.concatenate([every[:0], *(b.cells for b in state.bodies.of.records)])
        flexible = np.setdiff1d(every, inside)
        # With lumped masses nodes have one velocity each, those of bodies that of their body.
        touched = nodes_of(scene, {0: flexible})[: scene.owned_nodes] & (scene.mass != "lumped")
        self.difference = np.where(touched[:, None], (outside - self.nodal).reshape(-1, 3), 0.0)
        self.bodies = state.bodies.rates
        v, p = mass.createVecRight(), mass.createVecLeft()
        v.array[:] = self.nodal
        mass.mult(v, p)
        self.momenta: Array = p.array_r.copy()
        energy = float(self.nodal @ self.momenta)
        # The flexible cells at interfaces have other velocities there.
        differing = np.flatnonzero(self.difference.any(axis=1))
        if scene.sum(differing.size) > 0:
            own = np.ones(scene.owned_nodes, dtype=bool)
            for body in state.bodies.of.records:
                own[body.nodes] = False  # a point mass moves with the body that holds its node
            rows = Rows(scene.space, np.arange(scene.owned_nodes, dtype=np.int32))
            near = split(scene, forces.cells(flexible), differing)[1]
            theirs = Mass(scene, rows, near, own)
            v.array[:] = self.difference.reshape(-1)
            theirs.mult(v, p)
            theirs.destroy()
            self.momenta += p.array_r
            energy += float((2 * self.nodal + self.difference.reshape(-1)) @ p.array_r)
        blocks = state.bodies.given_mass_blocks
        given = np.einsum("ki,kij,kj->", self.bodies, blocks, self.bodies)
        self.energy = 0.5 * float(scene.sum(energy) + given)
        v.destroy()
        p.destroy()


class WholeMass:
    """Assembles M once for the same bodies of given mass: masses do not change with the motion."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Nothing is assembled."""
        self._scene, self._forces = scene, forces
        self._without: set[int] | None = None  # numbers of the bodies whose mass is given
        self._matrix: PETSc.Mat | None = None

    def matrix(self, bodies: Sequence[RigidBody]) -> PETSc.Mat:
        """M, one row per owned dof, which stays this object's own. Collective."""
        scene, given = self._scene, [body for body in bodies if body.given]
        without = {body.number for body in given}
        if self._matrix is not None and without == self._without:
            return self._matrix
        if self._matrix is not None:
            self._matrix.destroy()
        every = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        theirs = np.concatenate([every[:0], *(body.cells for body in given)])
        counted = np.ones(scene.owned_nodes, dtype=bool)
        for body in given:
            counted[body.nodes] = False
        rows = Rows(scene.space, np.arange(scene.owned_nodes, dtype=np.int32))
        cells = self._forces.cells(np.setdiff1d(every, theirs))
        operator = Mass(scene, rows, cells, counted)
        self._matrix, self._without = operator.matrix(), without
        operator.destroy()
        return self._matrix


class ConsistentExchange(Exchange):
    """The exchange with a consistent mass, or with joints.

    Attributes:
        motors: Motors that act and prescribe a motion, whose speed velocities after a switch have.
        dt: See `Motor.speed_at`.
    """

    scales = True

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Keep the problem."""
        super().__init__(scene, forces)
        self._mass = WholeMass(scene, forces)
        self.motors: tuple[Motor, ...] = ()
        self.dt = 0.0

    def _fields(self, state: State, prescribed: Bools, present: Present) -> RigidFields:
        return RigidFields(self._scene, state, prescribed, present.mass, self.motors, self.dt)

    def release(self, state: State, numbers: Set[int], prescribed: Bools) -> Works:
        """See `Exchange`."""
        self._owed, self._shaped = 0.0, set()
        if not numbers:
            return Works(0.0, 0.0)
        self._collapse(state, numbers)
        present = self._present(state)
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
        # interface has had, as a field that is possible now and adds no momenta.
        kept = np.zeros((self._scene.owned_nodes, 3))
        for body in gone:
            kept[body.data.nodes] += present.difference[body.data.nodes]
            frozen = body.data.frozen
            kept[frozen.nodes] += frozen.velocities @ body.motion.R.T
        at_rest = np.zeros_like(held)
        possible = after.project(after.momenta(kept.reshape(-1)), none, at_rest, False)
        own = np.zeros_like(of_given)
        own[was, :wide] = after.given_momenta(possible.bodies)[now]
        rigid = before.project(before.momenta(possible.nodal), own, at_rest, False)
        rigid_bodies[now] = rigid.bodies[was, :wide]
        mode = possible.plus(-1.0, Field(rigid.nodal, rigid_bodies))
        work = Works(
            self._work(present, prescribed, after.momenta(merged.nodal) - present.momenta),
            after.work(merged, held),
        )
        # Impulses that hold the difference are those that its rigid part has needed, reversed.
        of_mode = Works(
            self._work(present, prescribed, after.momenta(mode.nodal)), -before.work(rigid, held)
        )
        wanted = present.energy + work.whole + sum(body.data.frozen.vibration for body in gone)
        missing = wanted - 0.5 * after.product(merged, merged)
        if abs(missing) > ROUNDING * abs(wanted):
            mixed = after.product(merged, mode) - of_mode.whole
            square = after.product(mode, mode)
            scale = _scale(square, mixed, missing)
            self._owed = missing - scale * (mixed + 0.5 * scale * square)
        else:
            scale = 1.0
        _take(state, merged.plus(scale, mode))
        if faces:  # with the velocities of their nodes
            state.take_out(faces)
            with_faces(self._scene, self._forces, state)
        before.destroy()
        after.destroy()
        return Works(*(a + scale * b for a, b in zip(work, of_mode, strict=True)))

    def settle(self, state: State, division: Division, prescribed: Bools) -> None:
        """See `Exchange`."""
        if self._scene.mass == "lumped":
            super().settle(state, division, prescribed)
            return
        there = {body.data.number for body in state.bodies}
        new = [body for body in division.bodies if body.data.number not in there]
        if not new or self._continuous(state, division, new):
            state.group(division.bodies)
            return
        # Those of given mass all at once: their momenta are known, and not those of their cells.
        # They keep nothing, as they are never released.
        given = {body.data.number for body in new if body.data.given}
        first = [b for b in division.bodies if b.data.number in there | given]
        state.group(Bodies.of_each(first))
        if given:
            present = self._present(state)
            fields = self._fields(state, prescribed, present)
            of_given = fields.given_momenta(present.bodies)
            _take(state, fields.project(present.momenta, of_given, present.nodal[prescribed]))
            fields.destroy()
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
        return bool(gap <= CONTINUOUS * largest)

    def _include(self, state: State, body: Body, prescribed: Bools, named: bool = False) -> Works:
        """See `Exchange`; a named body keeps the work of supports as well. Collective."""
        present = self._present(state)
        faces = set() if named else _faces_within(self._scene, state, body.data.nodes)
        taken = [own for own in state.bodies if own.data.number in faces]
        state.group(Bodies.of_each(own for own in state.bodies if own.data.number not in faces))
        others = list(state.bodies)
        state.group(Bodies.of_each([*others, body]))
        of_given = np.einsum("kij,kj->ki", state.bodies.given_mass_blocks, state.bodies.rates)
        of_given[-1] = 0.0
        fields, held = self._fields(state, prescribed, present), present.nodal[prescribed]
        new = fields.project(present.momenta, of_given, held)
        lost: Array = np.reshape(present.nodal - new.nodal, (-1, 3))
        for own in taken:
            lost[own.data.frozen.nodes] += own.data.frozen.velocities @ own.motion.R.T
        size: Array = np.sqrt((lost**2).sum(axis=1))
        most = self._scene.comm.allreduce(float(size.max(initial=0.0)), op=MPI.MAX)
        nodes = np.flatnonzero(size > NEGLIGIBLE * most).astype(np.int32)
        work = Works(0.0, 0.0)
        if not named:
            gained = fields.momenta(new.nodal) - present.momenta
            work = Works(self._work(present, prescribed, gained), fields.work(new, held))
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
        present = self._present(state)
        fields = self._fields(state, prescribed, present)
        own = fields.given_momenta(present.bodies)
        new = fields.project(present.momenta, own, present.nodal[prescribed])
        gained = 0.5 * fields.product(new, new) - present.energy
        _take(state, new)
        fields.destroy()
        return gained if abs(gained) > ROUNDING * present.energy else 0.0

    def _work(self, present: Present, prescribed: Bools, gained: Array) -> float:
        """Work of supports by which all owned dofs gain momenta, at their velocity [J]."""
        return float(self._scene.sum(float(present.nodal[prescribed] @ gained[prescribed])))

    def _present(self, state: State) -> Present:
        mass = self._mass.matrix(state.bodies.of.records)
        return Present(self._scene, self._forces, state, mass)


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

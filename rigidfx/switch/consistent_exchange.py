"""Freeze and release with a consistent mass: exact in energy and momenta, beyond the paper's (6.2).

The mass couples a body's nodes with the flexible ones round it, so that neither (34) with (41) nor
any rule on the body's nodes alone keeps all balances. Here velocities are projected, in the metric
of the mass, on the fields P y that are rigid in the bodies:

    Pᵀ M P y = Pᵀ p,    p the momenta of all nodes.

What is projected out has no momenta, for rigid motions of the whole are among the P y, and its
energy is exactly the difference; both are kept by the new body. The flexible side of an interface,
which has a velocity of its own between switches, gets that of the body: otherwise the difference
would ring, with the other sign after each step. At a release the kept field
rotates with the body, brought into the range of the P that is valid then, made orthogonal to the
range valid before, so that it adds no momenta, and scaled by the one number that restores the
energy.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.coupling.dof_layout import nodes_of, rigid_fields
from rigidfx.coupling.mass import ConsistentMass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.decide.decision import PlannedBody
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body, Frozen
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.linear.linear_solver import conjugate_gradients
from rigidfx.step.system.division import Division
from rigidfx.switch.exchange import freeze

__all__ = ["ConsistentExchange"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

NEGLIGIBLE = 1e-15  # of the largest: difference velocities that need not be kept
CONTINUOUS = 1e-13  # of the largest: difference of velocities at an interface that is only rounding
ROUNDING = 1e-13  # of the energy: what is too little to find the scale of a field by


@dataclass(frozen=True)
class Field:
    """A velocity field that is rigid in bodies.

    Attributes:
        nodal: At all owned dofs, inside bodies too [m/s].
        bodies: Velocity of the centre and ℓω of each body, shape (bodies, 6) [m/s].
    """

    nodal: Array
    bodies: Array

    def plus(self, factor: float, other: Field) -> Field:
        """This field and a multiple of another."""
        return Field(self.nodal + factor * other.nodal, self.bodies + factor * other.bodies)


class RigidFields:
    """The velocity fields that are rigid in some bodies, and the projection on them.

    Bodies whose mass is given, and is not that of their cells, count by their own 6×6 matrix.
    """

    def __init__(self, scene: Scene, bodies: Bodies, prescribed: Bools, mass: PETSc.Mat) -> None:
        """Make P and the reduced mass matrix. Collective.

        Args:
            scene: The problem.
            bodies: The rigid bodies, in their present pose.
            prescribed: For each owned dof, whether a support prescribes it.
            mass: M of all cells but those in bodies whose mass is given.
        """
        self._mass = mass
        self._prolongation = Prolongation(rigid_fields(scene, bodies.of, prescribed), scene.comm)
        self._prescribed = np.flatnonzero(prescribed)
        self._y, self._r = self._prolongation.unknowns(), self._prolongation.unknowns()
        self._prolongation.pose(bodies)
        self._reduced = self._prolongation.condense(mass)
        self._blocks = _given_blocks(bodies)
        self._prolongation.add_blocks(self._reduced, self._blocks)
        self._full = mass.createVecRight()
        self._image = mass.createVecLeft()

    def momenta(self, v: Array) -> Array:
        """M v at the owned dofs [kg m/s]. Collective."""
        self._full.array[:] = v
        self._mass.mult(self._full, self._image)
        return self._image.array_r.copy()

    def project(self, momenta: Array, of_given: Array, v_prescribed: Array) -> Field:
        """The field with given momenta in all its directions. Collective.

        Args:
            momenta: At all owned dofs [kg m/s].
            of_given: Six of each body, those of its own mass where that is given [kg m/s].
            v_prescribed: Velocity of the held dofs [m/s].

        Raises:
            StepError: If conjugate gradients do not converge.
        """
        fixed = np.zeros_like(momenta)
        fixed[self._prescribed] = v_prescribed
        rest = momenta - self.momenta(fixed)
        self._full.array[:] = rest
        self._prolongation.restrict(self._full, of_given, self._r)
        self._y.set(0.0)
        if self._r.norm() > 0.0:
            conjugate_gradients(self._reduced, self._r, self._y)
        six = self._prolongation.bodies_part(self._y)
        self._prolongation.apply(self._y, six, v_prescribed, self._full)
        return Field(self._full.array_r.copy(), six)

    def given_momenta(self, bodies: Array) -> Array:
        """Momenta of the bodies whose mass is given, zero for the others, shape (bodies, 6)."""
        return np.einsum("kij,kj->ki", self._blocks, bodies)

    def product(self, a: Field, b: Field) -> float:
        """a·M b over all ranks [J]. Collective."""
        comm = self._prolongation.comm
        cells = comm.allreduce(float(a.nodal @ self.momenta(b.nodal)))
        return float(cells + np.vdot(a.bodies, self.given_momenta(b.bodies)))

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._y, self._r, self._reduced, self._full, self._image):
            item.destroy()


class ConsistentExchange:
    """The exchange with a consistent mass."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Take the problem over.

        Args:
            scene: The problem.
            forces: Internal forces.
        """
        self._scene, self._forces = scene, forces

    def release(self, state: State, numbers: Set[int], prescribed: Bools) -> None:
        """See `rigidfx.switch.exchange.Exchange`."""
        if not numbers:
            return
        present = self._present(state)
        before = RigidFields(self._scene, state.bodies, prescribed, present.mass)
        of_given = before.given_momenta(present.bodies)
        staying = [
            k for k, body in enumerate(state.bodies.of.records) if body.number not in numbers
        ]
        gone = state.take_out(numbers)
        after = RigidFields(self._scene, state.bodies, prescribed, present.mass)
        merged = after.project(present.momenta, of_given[staying], present.nodal[prescribed])
        # The kept field, rotated with its bodies, and the difference of the two velocities that the
        # interface has had, as a field that is possible now and adds no momenta.
        kept = np.zeros((self._scene.owned_nodes, 3))
        for body in gone:
            kept[body.data.nodes] += present.difference[body.data.nodes]
            frozen = body.data.frozen
            kept[frozen.nodes] += frozen.velocities @ body.motion.R.T
        at_rest = np.zeros(int(np.count_nonzero(prescribed)))
        none = np.zeros((len(staying), 6))
        possible = after.project(after.momenta(kept.reshape(-1)), none, at_rest)
        own = np.zeros_like(of_given)
        own[staying] = after.given_momenta(possible.bodies)
        rigid = before.project(before.momenta(possible.nodal), own, at_rest)
        mode = possible.plus(-1.0, Field(rigid.nodal, rigid.bodies[staying]))
        wanted = present.energy + sum(body.data.frozen.vibration for body in gone)
        missing = wanted - 0.5 * after.product(merged, merged)
        if abs(missing) > ROUNDING * abs(wanted):
            scale = _scale(after.product(mode, mode), after.product(merged, mode), missing)
        else:
            scale = 1.0
        _take(state, merged.plus(scale, mode))
        for item in (before, after, present):
            item.destroy()

    def freeze(self, state: State, what: PlannedBody, prescribed: Bools) -> bool:
        """See `rigidfx.switch.exchange.Exchange`."""
        body = freeze(self._scene, self._forces, state, what)
        if body is not None:
            self._include(state, body, prescribed)
        return body is not None

    def settle(self, state: State, division: Division, prescribed: Bools) -> None:
        """See `rigidfx.switch.exchange.Exchange`."""
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
            fields = RigidFields(self._scene, state.bodies, prescribed, present.mass)
            of_given = fields.given_momenta(present.bodies)
            _take(state, fields.project(present.momenta, of_given, present.nodal[prescribed]))
            fields.destroy()
            present.destroy()
        for body in new:
            if not body.data.given:
                self._include(state, body, prescribed)
        settled = {body.data.number: body for body in state.bodies}
        state.group(Bodies.of_each(settled[b.number] for b in division.bodies.of.records))

    def _continuous(self, state: State, division: Division, bodies: list[Body]) -> bool:
        """Whether flexible cells and bodies have one velocity where they meet. Collective."""
        meet = nodes_of(self._scene, division.flexible)
        gap = state.gap(bodies, [np.flatnonzero(meet[body.data.nodes]) for body in bodies])
        largest = float(np.abs(state.v.x.array).max(initial=0.0))
        gap, largest = np.max(self._scene.comm.allgather((gap, largest)), axis=0)
        return bool(gap <= CONTINUOUS * largest)

    def _include(self, state: State, body: Body, prescribed: Bools) -> None:
        """Have one more body, which keeps what it takes out of the motion. Collective."""
        present = self._present(state)
        of_given = np.einsum("kij,kj->ki", _given_blocks(state.bodies), state.bodies.six)
        others = list(state.bodies)
        state.group(Bodies.of_each([*others, body]))
        fields = RigidFields(self._scene, state.bodies, prescribed, present.mass)
        new = fields.project(
            present.momenta, np.vstack([of_given, np.zeros(6)]), present.nodal[prescribed]
        )
        lost: Array = np.reshape(present.nodal - new.nodal, (-1, 3))
        size: Array = np.sqrt((lost**2).sum(axis=1))
        most = self._scene.comm.allreduce(float(size.max(initial=0.0)), op=MPI.MAX)
        nodes = np.flatnonzero(size > NEGLIGIBLE * most).astype(np.int32)
        energy = present.energy - 0.5 * fields.product(new, new)
        # Beside a support that moves, what is taken out is not orthogonal to its motion: the
        # energy may be less than zero, and is kept as it is.
        frozen = Frozen(nodes, lost[nodes], body.data.frozen.strain, energy)
        body = replace(body, data=replace(body.data, frozen=frozen))
        state.group(Bodies.of_each([*others, body]))
        _take(state, new)
        fields.destroy()
        present.destroy()

    def _present(self, state: State) -> Present:
        return Present(self._scene, self._forces, state)


def _take(state: State, field: Field) -> None:
    """Make a field the state's velocity. Collective."""
    state.move(field.nodal)
    state.group(state.bodies.with_six(field.bodies))


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

    def __init__(self, scene: Scene, forces: InternalForces, state: State) -> None:
        """Assemble masses, and add up momenta and energy. Collective."""
        none, records = np.empty(0, np.int32), state.bodies.of.records
        every = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        given = np.concatenate([none, *(b.cells for b in records if b.given)])
        inside = np.concatenate([none, *(b.cells for b in records)])
        counted = np.setdiff1d(every, given)
        rows = Rows(scene.space, np.arange(scene.owned_nodes, dtype=np.int32))
        # A point mass moves with the body that holds its node.
        points = scene.point_masses[: scene.owned_nodes]
        counting, outside_bodies = points.copy(), points.copy()
        for body in records:
            outside_bodies[body.nodes] = 0.0
            if body.given:
                counting[body.nodes] = 0.0
        self._all = ConsistentMass(scene, rows, forces.cells(counted), points=counting)
        flexible = ConsistentMass(
            scene, rows, forces.cells(np.setdiff1d(every, inside)), points=outside_bodies
        )
        self.mass = self._all.matrix()
        n = 3 * scene.owned_nodes
        outside = state.v.x.array[:n].copy()
        self.nodal = outside.copy()
        for moving in state.bodies:
            self.nodal.reshape(-1, 3)[moving.data.nodes] = moving.velocities
        touched = nodes_of(scene, {0: np.setdiff1d(every, inside)})[: scene.owned_nodes]
        self.difference = np.where(touched[:, None], (outside - self.nodal).reshape(-1, 3), 0.0)
        self.bodies = state.bodies.six
        v, p = self.mass.createVecRight(), self.mass.createVecLeft()
        parts = []
        for mass, field in ((flexible, outside), (self._all, self.nodal), (flexible, self.nodal)):
            v.array[:] = field
            mass.mult(v, p)
            parts.append(p.array_r.copy())
        self.momenta = parts[0] + parts[1] - parts[2]
        energy = float(outside @ parts[0] + self.nodal @ (parts[1] - parts[2]))
        blocks = _given_blocks(state.bodies)
        own = np.einsum("ki,kij,kj->", self.bodies, blocks, self.bodies)
        self.energy = 0.5 * float(scene.sum(energy) + own)
        for item in (v, p, flexible):
            item.destroy()

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self.mass.destroy()
        self._all.destroy()


def _given_blocks(bodies: Bodies) -> Array:
    """Mass matrix of each body whose mass is given, zero for the others, shape (bodies, 6, 6)."""
    given = np.array([body.given for body in bodies.of.records], dtype=bool)
    return bodies.mass_blocks * given[:, None, None]


def _scale(square: float, mixed: float, missing: float) -> float:
    """The s > 0 nearest to 1 with ½ s² square + s mixed = missing; 0 if there is none.

    Args:
        square: mode·M mode ≥ 0 [J].
        mixed: What mode and the other motion have in common, zero but beside moving supports [J].
        missing: Energy that is to be given back [J].
    """
    discriminant = mixed**2 + 2 * square * missing
    if not (square > 0.0 and discriminant >= 0.0):
        return 0.0
    root = np.sqrt(discriminant)
    found = [float(s) for s in ((root - mixed) / square, (-root - mixed) / square) if s > 0.0]
    return min(found, key=lambda s: abs(s - 1.0), default=0.0)

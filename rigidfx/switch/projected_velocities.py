"""Velocities of a state as they are, and their projection on fields that are rigid in bodies.

    Pᵀ M P y = Pᵀ p,    p the momenta of all nodes.

Where there are joints, fields keep these closed as well: ∇g · v = 0 at the present places.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from rigidfx.base.errors import together
from rigidfx.base.matrices import free
from rigidfx.base.types import Array, Bools
from rigidfx.coupling.dof_layout import nodes_of, rigid_fields, split
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.ports import Ports
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Joint, Motor, Structure
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.remote import Points
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.linear.linear_solver import conjugate_gradients, solver_of
from rigidfx.mechanics.rigid_body import outside
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.newton.border import parted


class Present:
    """The velocities as they are, two of them where bodies meet flexible cells.

    They are given to all owned nodes, with the mass of all cells but those in bodies of given mass.

    Attributes:
        mass: M of all cells but those in bodies whose mass is given.
        nodal: Velocity of all owned dofs, the bodies' at their nodes [m/s].
        difference: At each owned node of an interface, the flexible cells' velocity less the
            body's; zero elsewhere, shape (nodes, 3) [m/s].
        bodies: Velocity of the centre and ℓω of each body, shape (bodies, 6) [m/s].
        momenta: Momenta at all owned dofs, but those of masses that are given [kg m/s].
        differing: The part of these by the difference.
        energy: Kinetic energy [J].
    """

    def __init__(self, scene: Scene, forces: InternalForces, state: State, mass: PETSc.Mat) -> None:
        """Add up momenta and energy. Collective."""
        self.mass, self._total = mass, scene.sum
        self.nodal: Array = state.v.x.array[: 3 * scene.owned_nodes].copy()
        beside = self.nodal.copy()
        for moving in state.bodies:
            self.nodal.reshape(-1, 3)[moving.data.nodes] = moving.velocities
        every = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
        inside = np.concatenate([every[:0], *(b.cells for b in state.bodies.of.records)])
        flexible = np.setdiff1d(every, inside)
        # With lumped masses nodes have one velocity each, those of bodies that of their body.
        touched = nodes_of(scene, {0: flexible})[: scene.owned_nodes] & (scene.mass != "lumped")
        self.difference = np.where(touched[:, None], (beside - self.nodal).reshape(-1, 3), 0.0)
        self.bodies = state.bodies.rates
        v, p = mass.createVecRight(), mass.createVecLeft()
        v.array[:] = self.nodal
        mass.mult(v, p)
        self.momenta: Array = p.array_r.copy()
        self.differing: Array = np.zeros_like(self.momenta)
        energy = float(self.nodal @ self.momenta)
        # The flexible cells at interfaces have other velocities there.
        differing = np.flatnonzero(self.difference.any(axis=1))
        if scene.sum(differing.size) > 0:
            # A point mass moves with the body that holds its node.
            own = outside(scene.owned_nodes, state.bodies.of.records)
            rows = Rows(scene.space, np.arange(scene.owned_nodes, dtype=np.int32))
            near = split(scene, forces.cells(flexible), differing)[1]
            theirs = Mass(scene, rows, near, own)
            v.array[:] = self.difference.reshape(-1)
            theirs.mult(v, p)
            theirs.destroy()
            self.differing = p.array_r.copy()
            self.momenta += self.differing
            energy += float((2 * self.nodal + self.difference.reshape(-1)) @ self.differing)
        blocks = state.bodies.given_mass_blocks
        given = np.einsum("ki,kij,kj->", self.bodies, blocks, self.bodies)
        self.energy = 0.5 * float(scene.sum(energy) + given)
        free(v, p)

    def work(self, prescribed: Bools, gained: Array) -> float:
        """Work of supports by which owned dofs gain momenta, at their velocity [J]. Collective."""
        return float(self._total(float(self.nodal[prescribed] @ gained[prescribed])))


class WholeMass:
    """Assembles M once for the same bodies of given mass: masses do not change with the motion."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        self._scene, self._forces = scene, forces
        self._without: set[int] | None = None  # numbers of the bodies whose mass is given
        self._matrix: PETSc.Mat | None = None  # one row per owned dof

    def present(self, state: State) -> Present:
        """The velocities of a state as they are. Collective."""
        scene, forces = self._scene, self._forces
        given = [body for body in state.bodies.of.records if body.given]
        without = {body.number for body in given}
        if without != self._without:
            every = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
            theirs = np.concatenate([every[:0], *(body.cells for body in given)])
            counted = outside(scene.owned_nodes, given)
            rows = Rows(scene.space, np.arange(scene.owned_nodes, dtype=np.int32))
            operator = Mass(scene, rows, forces.cells(np.setdiff1d(every, theirs)), counted)
            free(self._matrix)
            self._matrix, self._without = operator.matrix(), without
            operator.destroy()
        return Present(scene, forces, state, self._matrix)


@dataclass(frozen=True)
class Field:
    """A velocity field that is rigid in bodies."""

    nodal: Array  # at all owned dofs, inside bodies too [m/s]
    bodies: Array  # velocity of the centre and ℓω of each body, shape (bodies, 6) [m/s]
    # Those of joints that a projection has needed, one per row [N s, N m s]; None without joints
    impulses: Array | None = None

    def plus(self, factor: float, other: Field) -> Field:
        """This field and a multiple of another."""
        return Field(self.nodal + factor * other.nodal, self.bodies + factor * other.bodies)


class Closing:
    """Corrects velocities for the joints, at fixed places.

    The velocities that keep joints closed, D Eᵀ y = 0, and are nearest to given ones in the metric
    of the mass, are

        y - M⁻¹ E Dᵀ Λ,    (D Eᵀ M⁻¹ E Dᵀ) Λ = D Eᵀ y,

    with impulses Λ of the joints and the ports Eᵀ of `rigidfx.coupling.ports`. With redundant rows
    Λ is the least solution. Motors that prescribe a motion, locks among them, have a row each, with
    its speed s on the right side: their impulses do the work Λ·s. Ports on parts that M does not
    couple share a solve.
    """

    def __init__(
        self,
        state: State,
        linkage: Linkage,
        prolongation: Prolongation,
        mass: PETSc.Mat,
        solve: Callable[[Array], Array],
        dt: float,
    ) -> None:
        """Find the effects of unit impulses; a motor that fails is a `SceneError`. Collective."""
        self._linkage, self._sum = linkage, prolongation.sum
        linkage.begin(state.bodies)
        ports = Ports(prolongation, linkage)
        self._E = ports.entries
        self._D = linkage.test() @ ports.lead(prolongation.increments)
        Y = parted(mass, self._E).responses(solve)
        self._by_impulses = Y @ self._D.T
        resisted = self._D @ self._sum((self._E.T @ Y).toarray()) @ self._D.T
        speeds = together(prolongation.comm, "A motor", lambda: linkage.drives.speeds(state.t, dt))
        self._wanted = np.r_[np.zeros(resisted.shape[0] - speeds.size), speeds]
        self._inverse = np.linalg.pinv(resisted, hermitian=True)

    def impulses(self, y: Array, fixed: Array, driven: bool) -> tuple[Array, Array]:
        """Λ by velocities y that close the joints, one per row [N s, N m s]. Collective.

        And their addition to velocities of this rank's unknowns [m/s]. Supports give velocities of
        nodes, zero elsewhere [m/s]; motors rest if they are not driven.
        """
        rates = self._D @ self._sum(self._E.T @ y) + self._linkage.rates(fixed)
        if driven:
            rates -= self._wanted
        impulses = np.asarray(-self._inverse @ rates)
        return impulses, np.asarray(self._by_impulses @ impulses)

    def work(self, impulses: Array, fixed: Array) -> float:
        """Work of impulses while motors have their speeds and supports theirs [J]. Collective."""
        return float(impulses @ (self._wanted - self._linkage.rates(fixed)))


class RigidFields:
    """The velocity fields that are rigid in some bodies and keep joints; projects on them.

    Bodies whose mass is given, and is not that of their cells, count by their own 6×6 matrix.
    """

    def __init__(
        self,
        scene: Scene,
        state: State,
        prescribed: Bools,
        mass: PETSc.Mat,
        motors: Sequence[Motor] = (),
        dt: float = 0.0,
    ) -> None:
        """Make P and the reduced mass matrix. Collective.

        Bodies of the state are in their present pose, displacements outside of them known. M is
        that of all cells but those in bodies whose mass is given; for dt see `Motor.speed_at`.
        """
        self._mass, bodies = mass, state.bodies
        layout = rigid_fields(scene, bodies.of, prescribed)
        self._prolongation = Prolongation(layout, scene.comm)
        self._prescribed = np.flatnonzero(prescribed)
        self._y, self._r = self._prolongation.unknowns(), self._prolongation.unknowns()
        self._prolongation.pose(bodies)
        self._blocks = bodies.given_mass_blocks
        self._reduced = self._prolongation.condense(mass, self._blocks)
        self._full, self._image = mass.createVecRight(), mass.createVecLeft()
        self._factors: PETSc.KSP | None = None
        self._closing: Closing | None = None
        if joints := scene.named(Joint):
            # Closing joints takes a solve for each of their rows.
            self._factors = solver_of(self._reduced.copy(), brief=True)
            own, u = layout.massive, state.u.x.array
            structure = Structure(
                scene=scene, rows=layout.rows, own=own, bodies=bodies, mass=None, u=u
            )
            linkage = Linkage(joints, motors, structure, Points(()))
            known = linkage, self._prolongation, self._reduced
            self._closing = Closing(state, *known, self._solved, dt)

    def _solved(self, r: Array) -> Array:
        """The unknowns of their momenta. Collective."""
        self._r.array[:] = r
        self._solve()
        return self._y.array_r.copy()

    def _solve(self) -> None:
        """Find y of the momenta of the unknowns. Collective."""
        self._y.set(0.0)
        if self._r.norm() > 0.0:
            if self._factors is None:
                conjugate_gradients(self._reduced, self._r, self._y)
            else:
                self._factors.solve(self._r, self._y)

    def momenta(self, v: Array) -> Array:
        """M v at the owned dofs [kg m/s]. Collective."""
        self._full.array[:] = v
        self._mass.mult(self._full, self._image)
        return self._image.array_r.copy()

    def project(
        self, momenta: Array, of_given: Array, v_prescribed: Array, driven: bool = True
    ) -> Field:
        """The field with given momenta in all its directions. Collective.

        These are at all owned dofs, and six of each body whose mass is given [kg m/s]; held dofs
        have given velocities [m/s], and motors their speeds if they are driven. A StepError tells
        that conjugate gradients do not converge.
        """
        fixed, impulses = self._fixed(v_prescribed), None
        rest = momenta - self.momenta(fixed)
        self._full.array[:] = rest
        self._prolongation.restrict(self._full, of_given, self._r)
        self._solve()
        if self._closing is not None:
            impulses, added = self._closing.impulses(self._y.array_r, fixed, driven)
            self._y.array[:] += added
        six = self._prolongation.bodies_part(self._y)
        self._prolongation.apply(self._y, six, v_prescribed, self._full)
        return Field(self._full.array_r.copy(), six, impulses)

    def _fixed(self, v_prescribed: Array) -> Array:
        """Velocities of the held dofs among all owned ones, which are zero elsewhere [m/s]."""
        fixed = np.zeros(self._full.local_size)
        fixed[self._prescribed] = v_prescribed
        return fixed

    def work(self, found: Field, v_prescribed: Array) -> float:
        """Work of the impulses by which a projection has closed joints [J]. Collective."""
        if self._closing is None or found.impulses is None:
            return 0.0
        return self._closing.work(found.impulses, self._fixed(v_prescribed))

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
        free(self._y, self._r, self._reduced, self._full, self._image, self._factors)

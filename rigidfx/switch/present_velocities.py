"""Velocities and momenta of a state as they are: of nodes, interfaces and bodies.

They are given to all owned nodes, with the mass of all cells but those in bodies of given mass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from rigidfx.base.types import Array, Bools
from rigidfx.coupling.dof_layout import nodes_of, split
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.state import State


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
        self.mass, self._total = mass, scene.sum
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

    def work(self, prescribed: Bools, gained: Array) -> float:
        """Work of supports by which owned dofs gain momenta, at their velocity [J]. Collective."""
        return float(self._total(float(self.nodal[prescribed] @ gained[prescribed])))


class WholeMass:
    """Assembles M once for the same bodies of given mass: masses do not change with the motion."""

    def __init__(self, scene: Scene, forces: InternalForces) -> None:
        """Nothing is assembled."""
        self._scene, self._forces = scene, forces
        self._without: set[int] | None = None  # numbers of the bodies whose mass is given
        self._matrix: PETSc.Mat | None = None

    def present(self, state: State) -> Present:
        """The velocities of a state as they are. Collective."""
        return Present(self._scene, self._forces, state, self._of(state.bodies.of.records))

    def _of(self, bodies: Sequence[RigidBody]) -> PETSc.Mat:
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

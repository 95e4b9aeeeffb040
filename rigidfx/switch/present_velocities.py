"""Velocities, momenta and energy before a switch by projection."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.coupling.mass import mass_operator
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Present"]

Array = npt.NDArray[np.float64]


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
        free: npt.NDArray[np.bool_] = np.ones((2, scene.owned_nodes), dtype=bool)
        for body in records:
            free[:, body.nodes] = [[not body.given], [False]]
        lumped = scene.mass == "lumped"
        cells = forces.cells(counted), forces.cells(np.setdiff1d(every, inside))
        self._all = mass_operator(scene, rows, cells[0], free[0])
        flexible = mass_operator(scene, rows, cells[1], free[1])
        self.mass = self._all.matrix()
        n = 3 * scene.owned_nodes
        outside = state.v.x.array[:n].copy()
        self.nodal = outside.copy()
        for moving in state.bodies:
            self.nodal.reshape(-1, 3)[moving.data.nodes] = moving.velocities
        if lumped:  # nodes have one velocity each, those of bodies that of their body
            outside = self.nodal.copy()
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
        blocks = state.bodies.given_mass_blocks
        own = np.einsum("ki,kij,kj->", self.bodies, blocks, self.bodies)
        self.energy = 0.5 * float(scene.sum(energy) + own)
        for item in (v, p, flexible):
            item.destroy()

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self.mass.destroy()
        self._all.destroy()

"""Bodies and the flexible cells round them, which give way with their shadows.

What a body would strain, the difference ũ - u of two motions, obeys the equations of the whole
structure under ρ, which acts at the body's nodes. A shadow of the body alone is free at its border:
a cell that shares most of its nodes with flexible cells there takes forces that these would share.
So shadows have *margins*, a layer of the flexible cells round bodies, and are free behind these,
but for dashpots. What supports hold they hold in both motions: in margins, and in a part that is
held itself. Directions are those of a body's frame; in one that has turned since its freeze what
is held in some directions only is taken for free.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from rigidfx.coupling.at_nodes import AtNodes
from rigidfx.coupling.dof_layout import nodes_of
from rigidfx.coupling.mass import LumpedMass, Mass
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.scene.scene import Scene
from rigidfx.shadow.parts import Parts, mass_of
from rigidfx.shadow.rigid_motions import free_motions
from rigidfx.shadow.subjects import Subjects
from rigidfx.step.stepper import Stepper

__all__ = ["Margin"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]

NOBODY = -1
TURNED = 0.1  # of R, by which a body may have turned where directions are taken for its own


class Margin:
    """Rows of the nodes of some bodies and of their margins; no two of these share one.

    A cell that touches two bodies, or has a node within reach of two, is in no margin.

    Attributes:
        parts: The bodies.
        rows: These rows.
        cells: Owned cells of bodies and margins by subdomain id.
        around: Owned cells of margins, likewise.
        beyond: Owned flexible cells by subdomain id that share nodes, and are in no margin.
        inside: Places of the bodies' rows among these.
        round: Of each body, places of the nodes of its margin.
        supported: Which components of the rows' nodes supports hold, shape (nodes, 3).
        shape: Displacement in the bodies' frames, at the freeze and in margins now, shape
            (rows,) [m].
    """

    def __init__(self, stepper: Stepper, subjects: Subjects, bodies: Sequence[RigidBody]) -> None:
        """Find the margins. Collective.

        Args:
            stepper: Solves the steps.
            subjects: What has shadows.
            bodies: Their data.
        """
        self._scene = scene = stepper.scene
        self.parts = parts = Parts(scene, stepper.forces, bodies, subjects.free)
        state = stepper.state
        flexible, count = stepper.system.layout.flexible, len(parts.bodies)
        owners = np.full(scene.owned_nodes, float(NOBODY))
        for body in state.bodies:
            owners[body.data.nodes] = count  # of no concern, but in the way
        for k, data in enumerate(parts.bodies):
            owners[data.nodes] = k
        reach = _Reach(scene, owners, count)
        self.around: Cells = reach.within(flexible)
        margin = self.around
        self.cells: Cells = {
            i: np.sort(np.concatenate([own, margin.get(i, own[:0])]))
            for i, own in parts.cells.items()
        }
        taken, dofs = nodes_of(scene, self.cells), scene.space.dofmap.list
        self.beyond: Cells = {
            i: np.setdiff1d(own[taken[dofs[own]].any(axis=1)], margin[i])
            for i, own in flexible.items()
        }
        nodes = np.flatnonzero(taken[: scene.owned_nodes]).astype(np.int32)
        self.rows = Rows(scene.space, nodes)
        self.inside: Ints = self.rows.positions(parts.rows.nodes)
        of = np.where(owners[nodes] == NOBODY, reach.claims[nodes], NOBODY)
        self.round = tuple(np.flatnonzero(of == k) for k in range(count))
        held = subjects.held()[nodes]
        self.supported: Bools = held & held.all(axis=1, keepdims=True)
        shape = np.zeros((nodes.size, 3))
        shape[self.inside] = parts.shape.reshape(-1, 3)
        now = {id(body.data): body.motion for body in subjects.present()}
        for data, own, inside in zip(parts.bodies, self.round, parts.at, strict=True):
            at = now[id(data)]
            x = (state.positions(nodes[own].astype(np.int64)) - at.r) @ at.R + data.origin
            shape[own] = x - self.rows.X[own]
            if np.abs(at.R - np.eye(3)).max() <= TURNED:
                every = np.concatenate([self.inside[inside], own])
                self.supported[every] = held[every]
        self.shape: Array = shape.reshape(-1)

    def held(self) -> Ints:
        """Rows of this rank that keep bodies from moving: of supports, and of bodies. Collective.

        Forces in balance push on none of a body's.
        """
        rows = self.parts.held(self._free) - self.parts.rows.first
        nodes, axes = np.divmod(rows[(rows >= 0) & (rows < 3 * self.inside.size)], 3)
        return np.concatenate([self.supported_rows, 3 * self.inside[nodes] + axes])

    def unmoved(self, u: Array) -> Array:
        """Displacements without the rigid motions of bodies that nothing holds. Collective.

        Rows that are chosen to keep a body from moving turn it as they please: one choice on one
        rank, another on two.

        Args:
            u: Of the rows' nodes, shape (nodes, 3) [m].
        """
        out = u.copy()
        moving = self.parts.rigid_motion(u[self.inside], self._free)
        for own, places, numbers in zip(self._every, self._places, moving, strict=True):
            out[own] -= np.column_stack([np.ones(own.size), places]) @ numbers
        return out

    @cached_property
    def _every(self) -> list[Ints]:
        """Of each body, places of its rows and of those of its margin."""
        each = zip(self.parts.at, self.round, strict=True)
        return [np.concatenate([self.inside[at], own]) for at, own in each]

    @cached_property
    def _places(self) -> list[Array]:
        """Of each body, where these nodes are, relative to its centre, in its frame [m]."""
        x = self.rows.X + self.shape.reshape(-1, 3)
        each = zip(self.parts.bodies, self._every, strict=True)
        return [x[own] - data.origin for data, own in each]

    @cached_property
    def _free(self) -> list[Array]:
        """Of each body, the rigid motions that no support prevents. Collective."""
        comm = self._scene.comm
        each = zip(self.parts.bodies, self._places, self._every, strict=True)
        return [free_motions(x, self.supported[own], data.length, comm) for data, x, own in each]

    @cached_property
    def supported_rows(self) -> Ints:
        """The rows that supports hold."""
        return np.flatnonzero(self.supported)

    def mass(self) -> Mass:
        """Mass operator of the rows; the caller destroys it. Collective.

        A chain of masses that ends with half of one in a dashpot is one without an end.
        """
        scene, nodes = self._scene, self.rows.nodes
        if scene.mass != "lumped":
            return mass_of(scene, self.rows, self.cells)
        beyond = np.sort(np.concatenate([np.empty(0, np.int32), *self.beyond.values()]))
        rest = scene.cell_weights(scene.density(), beyond)[nodes]
        return LumpedMass(self.rows, scene.nodal_mass[nodes] - np.where(self.outside, rest, 0.0))

    @cached_property
    def outside(self) -> npt.NDArray[np.bool_]:
        """Which rows are none of bodies."""
        out = np.ones(self.rows.nodes.size, dtype=bool)
        out[self.inside] = False
        return out


class _Reach:
    """Which body each node is next to.

    Attributes:
        claims: Number of the body whose cells' neighbours a local node is of; NOBODY if there is
            none, or more than one.
    """

    def __init__(self, scene: Scene, owners: Array, count: int) -> None:
        self._dofs, self._count = scene.space.dofmap.list, count
        self._at_nodes = AtNodes(scene)
        self._owners = self._at_nodes.of_owners(owners)
        self.claims = np.full(self._owners.size, float(NOBODY))

    def within(self, flexible: Cells) -> Cells:
        """Owned flexible cells that are next to one body only, with all their nodes. Collective."""
        near = {i: own[self._near(self._dofs[own])] for i, own in flexible.items()}
        cells = np.concatenate([np.empty(0, np.int32), *near.values()])
        nodes = self._dofs[cells]
        own = self._owners[nodes].max(axis=1, initial=NOBODY)
        largest = self._at_nodes.largest
        most, least = largest(nodes, own), -largest(nodes, -own)
        agreed = (most == least) & (self._owners == NOBODY)
        self.claims[agreed] = most[agreed]
        held = np.where(self._owners == NOBODY, self.claims, self._owners)
        out = {}
        for i, cells in near.items():
            of = held[self._dofs[cells]]
            out[i] = cells[(of == of.max(axis=1, initial=NOBODY)[:, None]).all(axis=1)]
        return out

    def _near(self, nodes: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
        """Cells with nodes of one body, and of none that has no shadow."""
        own = self._owners[nodes]
        highest = own.max(axis=1, initial=NOBODY)
        mixed = ((own != NOBODY) & (own != highest[:, None])).any(axis=1)
        return (highest != NOBODY) & (highest < self._count) & ~mixed

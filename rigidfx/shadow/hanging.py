"""What hangs on a body, and how far it is carried as the body bends.

A body at the root of a cantilever that would bend by little turns all that is behind it: by its own
bend a stiff root of half a bar's length told a thirtieth of what the tip was off by. Without the
body a structure falls into pieces. Those that supports hold, its *anchors*, stay where they are
under a load slower than the structure, and the others, which *hang* on the body, move as rigid
bodies do by as much as it has bent between these and the anchors. What no support holds carries
nothing, nor is that asked of bodies with parts named rigid, which stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx.coupling.at_nodes import AtNodes
from rigidfx.domain.connected import connected_parts
from rigidfx.mechanics.rigid_body import Body
from rigidfx.shadow.parts import Parts
from rigidfx.shadow.rigid_motions import rigid_motions
from rigidfx.step.stepper import Stepper

__all__ = ["Hanging"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]

RIGID = 1e-9  # square of a rigid motion, over the largest, that places on a line do not tell


class Hanging:
    """Finds the pieces, and tells by how much bodies carry them."""

    def __init__(self, stepper: Stepper, parts: Parts, held: Bools) -> None:
        """Find what hangs on bodies. Collective.

        Args:
            stepper: Knows all bodies, the flexible cells, and the places of the nodes.
            parts: The bodies that are asked for.
            held: Which components of owned nodes supports hold, shape (nodes, 3).
        """
        self._scene, self._parts = stepper.scene, parts
        pieces = _Pieces(stepper, held)
        now = {id(body.data): (k, body) for k, body in enumerate(stepper.state.bodies)}
        measured = [id(data) in now and not data.named for data in parts.bodies]
        self._seams = [
            pieces.round(*now[id(data)]) if of else []
            for data, of in zip(parts.bodies, measured, strict=True)
        ]
        seams = [seam for each in self._seams for seam in each]
        squares = self._scene.sum(np.array([seam.square for seam in seams]).reshape(-1, 6, 6))
        for seam, square in zip(seams, np.asarray(squares), strict=True):
            seam.inverse = np.linalg.pinv(square, RIGID, hermitian=True)

    def carried(self, u: Array) -> Array:
        """How far each body carries what hangs on it, at most [m]. Collective.

        Args:
            u: Displacements of the parts' nodes, in the bodies' frames, shape (nodes, 3) [m].
        """
        out = np.zeros(len(self._seams))
        sums = [
            seam.sum(u[at])
            for at, seams in zip(self._parts.at, self._seams, strict=True)
            for seam in seams
        ]
        if not sums:
            return out
        motions = iter(np.asarray(self._scene.sum(np.array(sums))))
        for k, seams in enumerate(self._seams):
            still, *others = [seam.inverse @ next(motions) for seam in seams] or [np.zeros(6)]
            for motion, seam in zip(others, seams[1:], strict=True):
                far = np.linalg.norm(seam.corners @ (motion - still), axis=1)
                out[k] = max(out[k], float(far.max()))
        return out


@dataclass
class _Seam:
    """Where a body meets its anchors, or something that hangs on it.

    Attributes:
        at: Which of the body's nodes are there.
        motions: Rigid motions of these, shape (nodes, 3, 6).
        corners: Rigid motions of the corners of what hangs there, shape (corners, 3, 6).
        inverse: Of the sum of their products over all ranks, shape (6, 6).
    """

    at: Ints
    motions: Array
    corners: Array
    inverse: Array = field(default_factory=lambda: np.zeros((6, 6)))

    @property
    def square(self) -> Array:
        """Sum of products of the rigid motions, on this rank."""
        return np.asarray(np.einsum("nik,nil->kl", self.motions, self.motions))

    def sum(self, u: Array) -> Array:
        """Products of the rigid motions with displacements of the body's nodes, on this rank."""
        return np.asarray(np.einsum("nik,ni->k", self.motions, u[self.at]))


class _Pieces:
    """The pieces of flexible cells, and which bodies they touch; numbers are alike on all ranks.

    Of pieces and bodies together, the pieces come first.
    """

    def __init__(self, stepper: Stepper, held: Bools) -> None:
        scene, state = stepper.scene, stepper.state
        comm, at_nodes = scene.comm, AtNodes(scene)
        own = np.concatenate([np.empty(0, np.int32), *stepper.system.layout.flexible.values()])
        marks = fem.Function(scene.cell_space)
        dofs = marks.function_space.dofmap.list[:, 0]
        marks.x.array[dofs[own]] = 1.0
        marks.x.scatter_forward()
        found = connected_parts(scene.mesh, 0, marks.x.array[dofs] > 0)
        nodes = scene.space.dofmap.list[own]
        of_node = at_nodes.largest(nodes, found.of_cell[own].astype(np.float64))
        self._piece = np.where(np.isfinite(of_node), of_node, -1.0)[: scene.owned_nodes].astype(int)
        self._count, bodies = found.count, state.bodies
        owner = np.full(scene.owned_nodes, -1)
        for k, body in enumerate(bodies):
            owner[body.data.nodes] = self._count + k
        self._held: Bools = np.asarray(held.any(axis=1))
        every = self._count + len(bodies)
        members = [(of, of >= 0) for of in (self._piece, owner)]
        self._anchored = np.zeros(every, dtype=bool)
        self._lower, self._upper = np.full((every, 3), np.inf), np.full((every, 3), -np.inf)
        x = state.positions(np.arange(scene.owned_nodes))
        for of, inside in members:
            self._anchored[of[inside & self._held]] = True
            np.minimum.at(self._lower, of[inside], x[inside])
            np.maximum.at(self._upper, of[inside], x[inside])
        comm.Allreduce(MPI.IN_PLACE, self._anchored, op=MPI.LOR)
        comm.Allreduce(MPI.IN_PLACE, self._lower, op=MPI.MIN)
        comm.Allreduce(MPI.IN_PLACE, self._upper, op=MPI.MAX)
        both = (self._piece >= 0) & (owner >= 0)
        pairs = np.unique(np.stack([self._piece[both], owner[both]]), axis=1)
        self._pairs = np.unique(np.concatenate(comm.allgather(pairs), axis=1), axis=1)

    def round(self, number: int, body: Body) -> Sequence[_Seam]:
        """Where a body meets its anchors, and then each that hangs on it; empty if none does.

        Args:
            number: Its number among all bodies.
            body: The body.
        """
        own = self._count + number
        a, b = self._pairs[:, self._pairs[1] != own]
        n = self._anchored.size
        _, group = connected_components(coo_array((np.ones(a.size), (a, b)), (n, n)), False)
        touching = self._pairs[0, self._pairs[1] == own]
        group[own] = -1
        holding = np.unique(group[self._anchored])
        anchors = touching[np.isin(group[touching], holding)]
        nodes, places, length = body.data.nodes, body.data.offsets, body.data.length
        motions, of = rigid_motions(places, length), self._piece[nodes]
        still = np.isin(of, anchors) | self._held[nodes]
        if not (anchors.size or self._anchored[own]):
            return []
        at = np.flatnonzero(still)
        seams = [_Seam(at, motions[at], np.empty((0, 3, 6)))]
        for hanging in np.setdiff1d(group[touching], holding):
            at = np.flatnonzero(np.isin(of, touching[group[touching] == hanging]))
            corners = self._corners(np.flatnonzero(group == hanging))
            places = (corners - body.motion.r) @ body.motion.R
            seams.append(_Seam(at, motions[at], rigid_motions(places, length)))
        return seams if len(seams) > 1 else []

    def _corners(self, members: Ints) -> Array:
        """Corners of the boxes round pieces and bodies, shape (corners, 3) [m]."""
        ends = self._lower[members], self._upper[members]
        each = [
            np.stack([ends[side][:, axis] for axis, side in enumerate(sides)], axis=1)
            for sides in product((0, 1), repeat=3)
        ]
        return np.concatenate(each)

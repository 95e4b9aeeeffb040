"""The cells and nodes of some bodies, in the shape that they are frozen in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.rows import Rows
from rigidfx.flexible.internal_forces import Cells, InternalForces
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rigid_motions import independent, rigid_motions
from rigidfx.mechanics.rotation import axial, skew
from rigidfx.scene.scene import Scene


class Parts:
    """Rows of the nodes of some bodies, which share none; each body has its own frame.

    Attributes:
        bodies: The bodies' data.
        cells: Their owned cells by subdomain id.
        rows: Rows of their nodes.
        at: Of each body, its nodes among the rows.
        V: Positions of the rows' nodes relative to the centre of their body, in its frame, shape
            (nodes, 3) [m].
        shape: Displacement at the freeze, of the rows [m].
        coordinates: Of each body, [1, V, Φ] of its nodes, shape (nodes, 4 + 3 m) [1, m, 1].
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        bodies: Sequence[RigidBody],
    ) -> None:
        """Number the rows. Collective."""
        self.bodies = tuple(bodies)
        self._scene = scene
        none: list[Indices] = [np.empty(0, np.int32)]
        nodes = np.sort(np.concatenate([*none, *(body.nodes for body in bodies)]))
        self.cells: Cells = forces.cells(
            np.sort(np.concatenate([*none, *(body.cells for body in bodies)]))
        )
        self.rows = Rows(scene.space, nodes)
        self.at = tuple(self.rows.positions(body.nodes) for body in bodies)
        self.V: Array = np.zeros((nodes.size, 3))
        shape = np.zeros((nodes.size, 3))
        for body, at in zip(bodies, self.at, strict=True):
            self.V[at] = body.offsets
            shape[at] = body.displacement
        self.shape: Array = shape.reshape(-1)
        self._weights = scene.averaging_mass[nodes]
        self.coordinates = tuple(body.coordinates() for body in bodies)
        self._spans = tuple(map(_span, self.at))
        self._lengths = np.array([body.length for body in bodies])[:, None]
        self._inertia = self._inertia_of_each()

    def _inertia_of_each(self) -> Array:
        """Σ m modesᵀ modes of each body, shape (bodies, 6, 6) [kg]. Collective."""
        local = np.zeros((len(self.bodies), 6, 6))
        for block, body, at in zip(local, self.bodies, self.at, strict=True):
            modes = rigid_motions(self.V[at], body.length)
            block += np.einsum("n,nik,nil->kl", self._weights[at], modes, modes)
        return np.asarray(self._scene.sum(local))

    def linear(self, numbers: Array) -> Array:
        """What is linear in a node's place in its body: [1, V, Φ₁, ...] times numbers of that.

        Numbers have the shape (bodies, n, k); missing ones are zero. Shape (nodes, k).
        """
        out = np.empty((len(self.V), numbers.shape[2]))
        for k, (own, places) in enumerate(zip(self._spans, self.coordinates, strict=True)):
            of_body: Array = numbers[k, : places.shape[1]]
            out[own] = places[:, : len(of_body)] @ of_body
        return out

    def of_each(self, vectors: Iterable[Array]) -> Array:
        """Vectors at the nodes of each body, as those of the rows, shape (nodes, 3)."""
        out = np.empty_like(self.V)
        for own, of_body in zip(self._spans, vectors, strict=True):
            out[own] = of_body
        return out

    def rigid_motion(self, u: Array, free: Sequence[Array]) -> Array:
        """Of the rigid motions that are free the one that fits displacements best, by masses.

        Nodes of the rows move by u in the bodies' frames, shape (nodes, 3) [m]; each body is free
        as `free_motions` says. The motion is one of `linear`, shape (bodies, 4, 3). Collective.
        """
        local = np.zeros((len(self.bodies), 4, 3))
        for total, own, places in zip(local, self._spans, self.coordinates, strict=True):
            total[:] = places[:, :4].T @ (self._weights[own, None] * u[own])
        turning = axial(local[:, 1:]) / self._lengths
        sums = np.asarray(self._scene.sum(np.concatenate([local[:, 0], turning], axis=1)))
        out = np.empty_like(local)
        for numbers, inertia, F, total in zip(out, self._inertia, free, sums, strict=True):
            motion = F @ np.linalg.pinv(F.T @ inertia @ F) @ F.T @ total
            numbers[0] = motion[:3]
            numbers[1:] = skew(motion[3:]).T
        out[:, 1:] /= self._lengths[:, None]
        return out

    def mass(self) -> Mass:
        """Mass operator of the rows, all lumped masses counted: a new one. Collective."""
        counted = np.ones(self.rows.nodes.size, dtype=bool)
        return Mass(self._scene, self.rows, self.cells, counted)

    def held(self, free: Sequence[Array]) -> Ints:
        """Numbers of rows on all ranks that keep each body from moving, six at most. Collective.

        How each could move `free_motions` says.
        """
        out, comm = [], self._scene.comm
        for body, at, motions in zip(self.bodies, self.at, free, strict=True):
            modes = rigid_motions(self.V[at], body.length).reshape(-1, 6) @ motions
            own = (self.rows.first + 3 * at[:, None] + np.arange(3)).reshape(-1)
            best = independent(modes)
            offers = comm.allgather((modes[best], own[best]))
            rows = np.concatenate([m for m, _ in offers])
            numbers = np.concatenate([n for _, n in offers])
            out.append(numbers[independent(rows)])
        return np.concatenate([np.empty(0, np.int64), *out])


def _span(at: Ints) -> slice | Ints:
    """Numbers of rows; as a slice, which copies nothing, where one follows the other."""
    first = int(at[0]) if at.size else 0
    whole = np.array_equal(at, np.arange(first, first + at.size))
    return slice(first, first + at.size) if whole else at


def watched(bodies: Sequence[RigidBody], in_pieces: frozenset[str]) -> list[RigidBody]:
    """The bodies whose ρ is known, with cells and with the mass and inertia of these.

    Parts named rigid that are `in_pieces` are none: facets do not connect their cells.
    """
    own = (body for body in bodies if not body.given and not body.is_face)
    return [body for body in own if in_pieces.isdisjoint(body.named)]

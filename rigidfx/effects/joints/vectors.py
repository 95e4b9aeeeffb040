"""Vectors of joints, remote points and springs: places and directions by averages of nodes.

A side is a set of nodes with weights w, Σ w = 1, and places X at the start. Its affine mean gives
a point and a direction as Σ c x with constant c. A mean face shears: its directions turn with the
rotation that fits its nodes best, as those of a distributing coupling (RBE3). They depend on x̄ and
on H_k, by the axes r_k of docs/theory/joints.md#sides, which turn in a step by the Cayley vector θ
of N θ = -c(r½, ΔH). So vectors gain J̄ ΔB exactly, B the averages, and forces on vectors act on the
averages by J̄ᵀ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_array

from rigidfx.base.matrices import Matrix, Pattern, compact, dense
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure
from rigidfx.effects.nodes import Forces, ForcesOfNodes, Instant, Nodes
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import AXES, cross, nearest_rotations, skew


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Vector:
    """A place or a direction: Σ c x over owned nodes of all ranks and a constant, or of a face.

    One of a face turns with it, by its x̄, of which the nodes and weights are, and the three H_k.
    """

    nodes: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    weights: Array = field(default_factory=lambda: np.empty(0))  # c of each [1, or 1/m]
    constant: Array = field(default_factory=_zeros)  # shape (3,)
    start: Array = field(default_factory=_zeros)  # its value at the start
    is_place: bool = False  # and not a direction
    face: Any = None  # that it turns with
    holder: Any = None  # finds the body that it may be fixed to, as `FaceSide` does
    arm: Array = field(default_factory=_zeros)  # in the face or the body at the start [m, or 1]

    @property
    def averages(self) -> tuple[Vector, ...]:
        """The averages that it depends on: itself, or those of its face."""
        return (self,) if self.face is None else self.face.averages


@dataclass(frozen=True)
class StiffRow:
    """How a vector follows a body."""

    row: Array  # coefficients of the body's [1, V], shape (4,)
    body: int
    products: Array  # Σ w (X - X̄) ⊗ V of the face, shape (3, 3) [m²]


def stiff_rows(
    scene: Any, bodies: Sequence[RigidBody], vectors: Sequence[Any]
) -> dict[int, StiffRow]:
    """How vectors of faces that a body holds, and of carried masses, follow it, by their number."""
    holders = {id(v.holder): v.holder for v in vectors if v.holder is not None}
    found = {key: holder.within(scene, bodies) for key, holder in holders.items()}
    out: dict[int, StiffRow] = {}
    for k, vector in enumerate(vectors):
        if (held := found.get(id(vector.holder))) is not None:
            body, centre, products = held
            arm = nearest_rotations(products.T) @ vector.arm
            row = np.r_[1.0, centre + arm] if vector.is_place else np.r_[0.0, arm]
            out[k] = StiffRow(row, body, products)
    return out


class BoundAverages(Nodes):
    """Averages of nodes, which are free or in bodies; arrays are equal on all ranks.

    They have weights `own` of nodes that are no body's, shape (averages, these nodes), and `held`
    of the bodies' a = [1, V, Φ₁, ..., Φ_m], shape (averages, n · bodies).
    """

    def __init__(
        self, averages: Sequence[Vector], stiff: Mapping[int, StiffRow], structure: Structure
    ) -> None:
        """Find whose nodes are; `stiff` are rows of averages that follow bodies. Collective."""
        scene, own = structure.scene, [average.nodes for average in averages]
        number = np.repeat(np.arange(len(own)), [some.size for some in own])
        values = np.concatenate([np.empty(0), *(average.weights for average in averages)])
        at = number, np.concatenate([np.empty(0, np.int64), *own])
        W = csr_array((values, at), shape=(len(own), scene.owned_nodes))
        super().__init__(structure, np.flatnonzero(np.diff(W.tocsc().indptr)))
        self._once, self._W = bool(structure.once), W[:, self.nodes].tocsr()
        count = self.rows.size
        self.own = self._W[:, :count].tocsr()
        every = np.asarray(scene.sum(dense(self._W[:, count:] @ self._A)))
        for k, row in stiff.items():
            every[k].reshape(len(structure.bodies), -1)[row.body, :4] = row.row
        self.held = csr_array(every)
        self._spread, self._moments = self.own.T.tocsr(), compact(self.held.T.tocsr())
        self._poses = compact(self.held.tocsr())
        self.is_place = [average.is_place for average in averages]
        self._constant = np.reshape([average.constant for average in averages], (-1, 3))

    def mean(self, of_rows: Array) -> Array:
        """Averages of vectors at nodes, those in bodies left out. Collective."""
        out = np.asarray(self.own @ of_rows)
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out

    def _all(self, of_rows: Array, matrices: Array) -> Array:
        return self.mean(of_rows) + self._poses @ matrices.reshape(-1, 3)

    def positions(self, at: Instant) -> Array:
        """See `Nodes`; with the constants. Collective."""
        return super().positions(at) + self._constant

    def add(self, force: Array, forces: Forces | ForcesOfNodes) -> None:
        """Add forces on averages, shape (averages, 3) [N], which all ranks know."""
        if isinstance(forces, ForcesOfNodes):
            forces.add(self, self._W.T @ force)
            return
        forces.nodes[self.rows] += self._spread @ force
        if forces.moments.size and self._once:
            forces.moments[...] += (self._moments @ force).reshape(forces.moments.shape)


class Vectors:
    """Vectors of joints as functions of averages; arrays are equal on all ranks."""

    def __init__(self, vectors: Sequence[Vector], stiff: Mapping[int, StiffRow]) -> None:
        """Collect the averages; `stiff` are rows of vectors of faces that a body holds."""
        self.averages: list[Vector] = []  # B, each once
        self.stiff: dict[int, StiffRow] = {}  # of those that follow a body, by their number
        self.needed: list[Ints] = []  # for each vector, the numbers of its averages
        self.count = len(vectors)
        first_of: dict[int, int] = {}
        for n, vector in enumerate(vectors):
            key = -1 - n if vector.face is None or n in stiff else id(vector.face)
            own = vector.averages
            if n in stiff:  # a row of a body, whatever its nodes
                self.stiff[len(self.averages)] = stiff[n]
                own = (Vector(is_place=vector.is_place),)
            if key not in first_of:
                first_of[key] = len(self.averages)
                self.averages += own
            self.needed.append(first_of[key] + np.arange(len(own)))
        faces = [(n, vector) for n, vector in enumerate(vectors) if vector.face is not None]
        turned = [(n, vector) for n, vector in faces if n not in stiff]
        self._held = [(n, vector, stiff[n]) for n, vector in faces if n in stiff]
        # Each vector is its first average, none of directions of faces, and an arm that turns.
        self._first = np.array([own[0] for own in self.needed], dtype=np.int64)
        self._turned: Ints = np.array([n for n, _ in turned], dtype=np.int64)
        self.is_plain = not turned  # whether each vector is an average
        self._begins: Array = np.ones((self.count, 1))
        self._begins[self._turned, 0] = [vector.is_place for _, vector in turned]
        self._local = np.reshape([v.arm @ v.face.axes for _, v in turned], (-1, 1, 3))
        self._centres, self._face = np.unique(self._first[self._turned], return_inverse=True)
        none: Array = np.zeros((len(self.averages), 3))
        self._start, self._moved = none, none
        self._r0 = self._r1 = nearest_rotations(self._of_faces(none))
        self._parts: dict[float, tuple[Array, Array, Array]] = {}  # of this iterate
        self._slopes: dict[float, Matrix] = {}  # likewise
        size, of_axes = none.size, 3 * self._centres[:, None] + 3 + np.arange(9)
        begin = (3 * self._first[:, None] + AXES).ravel()
        row, column = _entries(3 * self._turned[:, None] + AXES, of_axes[self._face])
        places = np.r_[np.arange(begin.size), row], np.r_[begin, column]
        self._pattern = Pattern(*places, (3 * self.count, size))
        self._bent = Pattern(*_entries(of_axes, of_axes), (size, size))

    def _of_faces(self, B: Array) -> Array:
        """H_k of all faces, shape (faces, 3, 3)."""
        return np.asarray(B[self._centres[:, None] + 1 + AXES])

    def _values(self, B: Array, turned: Array) -> Array:
        """Vectors by averages and turned arms."""
        out = self._begins * B[self._first]
        out[self._turned] += turned
        return out

    def _arms(self, r: Array) -> Array:
        """Arms that turn with axes r, shape (..., turned vectors, 3)."""
        return np.asarray((self._local @ r[..., self._face, :, :])[..., 0, :])

    def at(self, B: Array) -> Array:
        """The vectors where averages are at B, shape (vectors, 3)."""
        return (
            B
            if self.is_plain
            else self._values(B, self._arms(nearest_rotations(self._of_faces(B))))
        )

    def begin(self, B: Array) -> Array:
        """Begin a step where averages are at B; the vectors, shape (vectors, 3)."""
        self._start, self._moved, self._parts, self._slopes = B, np.zeros_like(B), {}, {}
        self._r0 = self._r1 = nearest_rotations(self._of_faces(B))
        return self.at(B)

    def look(self, moved: Array) -> Array:
        """See an iterate: increments of averages; those of vectors, shape (vectors, 3)."""
        self._moved, self._parts, self._slopes = moved, {}, {}
        if self.is_plain:
            return moved
        self._r1 = nearest_rotations(self._of_faces(self._start + moved))
        r, _, turns = self._part(0.5)
        theta = np.einsum("fakb,fkb->fa", turns, self._of_faces(moved))
        return self._values(moved, cross(theta[self._face], self._arms(r)))

    def _part(self, share: float) -> tuple[Array, Array, Array]:
        """r, H and θ by δH of all faces in the middle of the step (0.5), or at its ends."""
        if share not in self._parts:
            H = self._of_faces(self._start + share * self._moved)
            r = (1 - share) * self._r0 + share * self._r1
            self._parts[share] = r, H, turn_map(r, H)
        return self._parts[share]

    def slopes(self, share: float) -> Matrix:
        """Derivatives of vectors by averages, shape (3 · vectors, 3 · averages).

        The share is 0.5 for J̄ of the step, 0 and 1 for derivatives at its start and end.
        """
        if share not in self._slopes:
            r, _, turns = self._part(share)
            moved = -skew(self._arms(r)) @ turns.reshape(-1, 3, 9)[self._face]
            values = np.r_[np.repeat(self._begins, 3), moved.ravel()]
            self._slopes[share] = self._pattern.filled(values)
        return self._slopes[share]

    def onto_averages(self, rows: Matrix, share: float) -> Matrix:
        """Derivatives by vectors as those by averages."""
        return rows if self.is_plain else rows @ self.slopes(share)

    def rates(self, of_averages: Array, share: float) -> Array:
        """Rates of vectors by those of averages, shape (3 · vectors,)."""
        return of_averages if self.is_plain else np.asarray(self.slopes(share) @ of_averages)

    def forces(self, on_vectors: Array, share: float) -> Array:
        """Forces on averages of those on vectors, shape (averages, 3) [N]."""
        if self.is_plain:
            return on_vectors
        return np.asarray(self.slopes(share).T @ on_vectors.ravel()).reshape(-1, 3)

    def spread(self, on_vectors: Array, pose: Array, forces: ForcesOfNodes) -> None:
        """Add forces on the nodes of faces, of vectors that bodies of these poses hold [N]."""
        faces = {id(vector.face): (vector.face, held) for _, vector, held in self._held}
        means = [np.zeros((0, 3))]
        for face, held in faces.values():
            H = face.axes.T @ held.products @ pose[held.body, 1:4] / face.size**2
            means += [np.zeros((1, 3)), H]
        every = Vectors([vector for _, vector, _ in self._held], {})
        every.begin(np.concatenate(means))
        on_averages = every.forces(on_vectors[[n for n, *_ in self._held]], 0.0)
        for average, force in zip(every.averages, on_averages, strict=True):
            forces.nodes[average.nodes] += np.outer(average.weights, force)

    def stiffness(self, by_vectors: Matrix, on_vectors: Array, share: float) -> Matrix:
        """Derivative of `forces` by the averages at the end, shape (3 · averages,) * 2 [N/m].

        Forces on vectors have their own derivative by these, shape (3 · vectors,) * 2 [N/m].
        """
        if self.is_plain:
            return by_vectors
        own = self.slopes(share).T @ (by_vectors @ self.slopes(1.0))
        # With these kept, by complex steps of each H_k, with which the axes at the end turn.
        (r, H, _), (r_end, _, turns) = self._part(share), self._part(1.0)
        h = float(np.finfo(np.float64).eps)
        theta = np.moveaxis(turns.reshape(-1, 3, 9), -1, 0)[:, :, None]
        r = r + 1j * h * share * cross(theta, r_end)
        H = H + 1j * h * share * np.eye(9).reshape(9, 1, 3, 3)
        couples = np.zeros((len(self._centres), 9, 3), complex)  # of each face, Σ d × f
        each = cross(self._arms(r), on_vectors[self._turned])
        np.add.at(couples, self._face, each.swapaxes(0, 1))
        on_averages = np.einsum("dfakb,fda->fkbd", turn_map(r, H), couples)
        return own + self._bent.filled((on_averages.imag / h).ravel())


def slopes_of(vector: Vector) -> Array:
    """Derivatives of a vector by displacements of its nodes at the start, shape (nodes, 3, 3)."""
    of = Vectors([vector], {})
    of.begin(np.array([a.start for a in vector.averages]))
    weights = np.array([a.weights for a in vector.averages])
    return np.einsum("kn,ikj->nij", weights, dense(of.slopes(0.0)).reshape(3, -1, 3))


def value_at(scene: Any, vector: Vector, x: Array) -> Array:
    """A vector where owned nodes are at x, shape (nodes, 3) [m]. Collective."""
    return motion_at(scene, vector, x, np.zeros_like(x))[0]


def motion_at(scene: Any, vector: Vector, x: Array, v: Array) -> tuple[Array, Array]:
    """A vector and its rate where nodes are at x and move with v, shape (3,) each. Collective."""
    every = [[a.weights @ of[a.nodes] for a in vector.averages] for of in (x, v)]
    means, rates = np.asarray(scene.sum(every))
    of = Vectors([vector], {})
    value = of.begin(means + [a.constant for a in vector.averages])[0]
    return value, dense(of.slopes(0.0)) @ rates.ravel()


def turn_map(r: Array, H: Array) -> Array:
    """θ by δH, -N⁻¹ c(r, ·), by axes r and H_k in rows, shape (..., 3, 3, 3)."""
    c = np.moveaxis(skew(r.swapaxes(-1, -2)), -3, -1)
    N = np.einsum("...jka,...kab->...jb", c, skew(H))
    return -np.linalg.solve(N, c.reshape(*N.shape[:-1], 9)).reshape(c.shape)


def _entries(rows: Ints, columns: Ints) -> tuple[Ints, Ints]:
    """Rows and columns of the entries of blocks with these, shape (blocks, n) each."""
    row, column = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
    return row.ravel(), column.ravel()

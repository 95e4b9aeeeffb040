"""Vectors of joints by the averages that they depend on, with their exact gains in a step.

Most vectors are an average themselves. Those of mean faces turn with the face (`face_motion`): in a
step they gain J̄ ΔB exactly, B the averages, and forces on vectors act on the averages by J̄ᵀ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigidfx.base.matrices import Matrix, Pattern
from rigidfx.base.types import Array, Ints
from rigidfx.effects.joints.averages import Average
from rigidfx.effects.joints.bound_averages import StiffRow
from rigidfx.effects.joints.face_motion import FaceVector, Vector, cyclic, turn_map
from rigidfx.effects.motion import ForcesOfNodes
from rigidfx.mechanics.rotation import AXES, cross, nearest_rotations, skew

__all__ = ["Vectors"]


class Vectors:
    """Vectors of joints as functions of averages; arrays are equal on all ranks.

    Attributes:
        averages: The averages B, each once.
        stiff: Rows of those that follow a body, by their number.
        needed: For each vector, the numbers of its averages.
    """

    def __init__(self, vectors: Sequence[Vector], stiff: Mapping[int, StiffRow]) -> None:
        """Collect the averages.

        Args:
            vectors: The vectors.
            stiff: Rows of the vectors of faces that a body holds, by their number.
        """
        self.averages: list[Average] = []
        self.stiff: dict[int, StiffRow] = {}
        self._held: list[tuple[int, Vector, StiffRow]] = []
        self.needed: list[Ints] = []
        first_of: dict[int, int] = {}
        turned: list[tuple[int, FaceVector]] = []
        for n, vector in enumerate(vectors):
            if n in stiff:  # a row of a body, whatever its nodes
                self.stiff[len(self.averages)] = stiff[n]
                self._held.append((n, vector, stiff[n]))
                vector = Average(is_place=vector.is_place)
            key = id(vector.face) if isinstance(vector, FaceVector) else -1 - n
            if key not in first_of:
                first_of[key] = len(self.averages)
                self.averages += vector.averages
            count = len(vector.averages)
            self.needed.append(first_of[key] + np.arange(count))
            if isinstance(vector, FaceVector):
                turned.append((n, vector))
        self.count = len(vectors)
        self._plain: Ints = np.array(
            [n for n, own in enumerate(self.needed) if own.size == 1], dtype=np.int64
        )
        self._of_plain: Ints = np.array([self.needed[n][0] for n in self._plain], dtype=np.int64)
        self._turned: Ints = np.array([n for n, _ in turned], dtype=np.int64)
        centres = np.array([self.needed[n][0] for n, _ in turned], dtype=np.int64)
        self._centres, self._face = np.unique(centres, return_inverse=True)  # of faces
        self._local = np.reshape([vector.local for _, vector in turned], (-1, 1, 3))
        self._is_place = np.array([vector.is_place for _, vector in turned], dtype=float)
        none: Array = np.zeros((len(self.averages), 3))
        self._start, self._moved = none, none
        self._r0 = self._r1 = self._axes(none)
        self._pattern = Pattern(*self._places(), (3 * self.count, 3 * len(self.averages)))
        self._parts: dict[float, tuple[Array, Array, Array, Array]] = {}  # of this iterate
        self._slopes: dict[float, Matrix] = {}  # likewise
        columns = 3 * self._centres[:, None] + 3 + np.arange(9)
        bent = np.broadcast_arrays(columns[:, :, None], columns[:, None, :])
        size = 3 * len(self.averages)
        self._bent = Pattern(bent[0].ravel(), bent[1].ravel(), (size, size))

    @property
    def is_plain(self) -> bool:
        """Whether each vector is an average."""
        return not self._turned.size

    def _places(self) -> tuple[Ints, Ints]:
        """Rows and columns of derivatives by averages: of plain ones, places, and directions."""
        own = 3 * self._plain[:, None] + AXES, 3 * self._of_plain[:, None] + AXES
        rows, first = 3 * self._turned[:, None], self._centres[self._face][:, None]
        centre = rows + AXES, 3 * first + AXES
        columns = 3 * first + 3 + np.arange(9)
        turns = np.broadcast_arrays((rows + AXES)[:, :, None], columns[:, None, :])
        both = [own, centre, turns]
        row, column = (np.concatenate([pair[k].ravel() for pair in both]) for k in range(2))
        return row, column

    def _of_faces(self, B: Array) -> Array:
        """H_k of all faces, shape (faces, 3, 3)."""
        return np.asarray(B[self._centres[:, None] + 1 + AXES])

    def _axes(self, B: Array) -> Array:
        """r_k of all faces, likewise."""
        return nearest_rotations(self._of_faces(B))

    def _values(self, B: Array, turned: Array) -> Array:
        """Vectors by averages and turned arms."""
        out = np.empty((self.count, 3))
        out[self._plain] = B[self._of_plain]
        centre = B[self._centres[self._face]]
        out[self._turned] = self._is_place[:, None] * centre + turned
        return out

    def _arms(self, r: Array) -> Array:
        """Arms that turn with axes r, shape (turned vectors, 3)."""
        return (self._local @ r[self._face])[:, 0]

    def at(self, B: Array) -> Array:
        """The vectors where averages are at B, shape (vectors, 3)."""
        return B if self.is_plain else self._values(B, self._arms(self._axes(B)))

    def begin(self, B: Array) -> Array:
        """Begin a step where averages are at B; the vectors, shape (vectors, 3)."""
        self._start, self._moved, self._parts, self._slopes = B, np.zeros_like(B), {}, {}
        self._r0 = self._r1 = self._axes(B)
        return self.at(B)

    def look(self, moved: Array) -> Array:
        """See an iterate: increments of averages; those of vectors, shape (vectors, 3)."""
        self._moved, self._parts, self._slopes = moved, {}, {}
        if self.is_plain:
            return moved
        self._r1 = self._axes(self._start + moved)
        r, _, _, turns = self._part(0.5)
        theta = np.einsum("fakb,fkb->fa", turns, self._of_faces(moved))
        return self._values(moved, cross(theta[self._face], self._arms(r)))

    def _part(self, share: float) -> tuple[Array, Array, Array, Array]:
        """r, H, N⁻¹ and θ by δH of all faces in the middle of the step (0.5), or at its ends."""
        if share not in self._parts:
            H = self._of_faces(self._start + share * self._moved)
            r = (1 - share) * self._r0 + share * self._r1
            self._parts[share] = (r, H, *turn_map(r, H))
        return self._parts[share]

    def slopes(self, share: float) -> Matrix:
        """Derivatives of vectors by averages, shape (3 · vectors, 3 · averages).

        Args:
            share: 0.5 for J̄ of the step, 0 and 1 for derivatives at its start and end.
        """
        if share not in self._slopes:
            r, _, _, turns = self._part(share)
            moved = -skew(self._arms(r)) @ turns.reshape(-1, 3, 9)[self._face]
            plain, places = np.ones(3 * self._plain.size), np.repeat(self._is_place, 3)
            values = np.concatenate([plain, places, moved.ravel()])
            self._slopes[share] = self._pattern.filled(values)
        return self._slopes[share]

    def onto_averages(self, rows: Matrix, share: float) -> Matrix:
        """Derivatives by vectors as those by averages."""
        return rows if self.is_plain else rows @ self.slopes(share)

    def forces(self, on_vectors: Array, share: float) -> Array:
        """Forces on averages of those on vectors, shape (averages, 3) [N]."""
        if self.is_plain:
            return on_vectors
        return np.asarray(self.slopes(share).T @ on_vectors.ravel()).reshape(-1, 3)

    def spread(self, on_vectors: Array, pose: Array, forces: ForcesOfNodes) -> None:
        """Add forces on the nodes of faces, of vectors that a body holds.

        Args:
            on_vectors: Forces on vectors, shape (vectors, 3) [N].
            pose: Matrices of the places of bodies, shape (bodies, n, 3).
            forces: Forces on nodes.
        """
        for n, vector, held in self._held:
            means = None
            if isinstance(vector, FaceVector):
                face = vector.face
                H = face.axes.T @ held.products @ pose[held.body, 1:4] / face.size**2
                means = np.vstack([np.zeros(3), H])
            own = np.einsum("nij,i->nj", vector.slopes(means), on_vectors[n])
            forces.nodes[vector.nodes] += own

    def stiffness(self, by_vectors: Matrix, on_vectors: Array, share: float) -> Matrix:
        """Derivative of `forces` by the averages at the end, shape (3 · averages,) * 2 [N/m].

        Args:
            by_vectors: Derivative of forces on vectors by these, shape (3 · vectors,) * 2 [N/m].
            on_vectors: Forces on vectors, shape (vectors, 3) [N].
            share: 0.5 for forces of the middle of a step, 1 for those of its end.
        """
        if self.is_plain:
            return by_vectors
        own = self.slopes(share).T @ (by_vectors @ self.slopes(1.0))
        return own + self.curvature(on_vectors, share)

    def curvature(self, on_vectors: Array, share: float) -> Matrix:
        """Derivative of `forces` by the averages at the end, forces on vectors kept.

        With (2) of `face_motion`, the couple m = Σ d × f acts on H_k by Σ S_ik r_i, where the
        numbers μ of the skew matrix S are -N⁻ᵀ m.

        Args:
            on_vectors: Forces on vectors, shape (vectors, 3) [N].
            share: 0.5 for forces of the middle of a step, 1 for those of its end.

        Returns:
            Shape (3 · averages,) * 2 [N/m].
        """
        r, H, inverse, _ = self._part(share)
        end = self._part(1.0)
        turned_end = end[3].reshape(-1, 3, 9)
        f, faces = on_vectors[self._turned], len(self._centres)
        d, d1 = self._arms(r), self._arms(end[0])
        m, dm = np.zeros((faces, 3)), np.zeros((faces, 3, 3))
        np.add.at(m, self._face, cross(d, f))
        np.add.at(dm, self._face, share * _double_cross(d1, f))
        mu = -np.einsum("faj,fa->fj", inverse, m)
        by_turn, by_H = dm, np.zeros((faces, 3, 3, 3))
        for j, i, k in cyclic():
            own = mu[:, j, None, None]
            by_turn = by_turn + own * share * _double_cross(end[0][:, i], H[:, k])
            by_turn = by_turn - own * share * _double_cross(end[0][:, k], H[:, i])
            by_H[:, :, k] += own * share * skew(r[:, i])
            by_H[:, :, i] -= own * share * skew(r[:, k])
        change = by_turn @ turned_end + by_H.reshape(-1, 3, 9)
        dmu = -np.einsum("faj,fab->fjb", inverse, change)
        out = np.zeros((faces, 3, 3, 9))
        for j, i, k in cyclic():
            for at, of, sign in ((k, i, 1.0), (i, k, -1.0)):
                turned = -share * skew(end[0][:, of]) @ turned_end
                step = r[:, of, :, None] * dmu[:, j, None, :] + mu[:, j, None, None] * turned
                out[:, at] += sign * step
        return self._bent.filled(out.ravel())


def _double_cross(a: Array, b: Array) -> Array:
    """The matrices of (θ × a) × b by θ, shape (n, 3, 3): a (θ · b) - θ (a · b)."""
    dot = (a * b).sum(axis=-1)
    return a[:, :, None] * b[:, None, :] - dot[:, None, None] * np.eye(3)

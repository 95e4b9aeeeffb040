"""Places and directions of sides: averages of the places of nodes, and vectors that turn with them.

A side is a set of nodes with weights w, Σ w = 1, and places X at the start. Its affine mean gives
a point and a direction as Σ c x with constant c: exactly, while the part is rigid. A mean face
shears: its directions turn with the rotation R that makes Σ w |x - x̄ - R (X - X̄)|² least, as those
of a distributing coupling (RBE3). They depend on x̄ and on H_k = Σ w (X - X̄)·a_k x / s². The axes
r_k = R a_k are those for which

    c_j = r_i · H_k - r_k · H_i = 0,    (j, i, k) cyclic,                                       (1)

and in a step the axes turn by the Cayley vector θ of

    N θ = -c(r½, ΔH),    N θ = c(r½, θ × H½) for all θ,                                         (2)

exactly: docs/theory/joints.md, also for nodes that one body holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Ints
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import nearest_rotations, skew


@dataclass(frozen=True)
class Average:
    """A vector that is Σ c x over owned nodes of all ranks, and a constant, shape (3,).

    Attributes:
        weights: c of each [1, or 1/m].
        start: Its value at the start, shape (3,).
        is_place: Whether it is a place, not a direction.
        holder: Finds the body that it may be fixed to, as `FaceSide` does; None without one.
        face: The face that it turns with: none, as it is linear.
    """

    face: ClassVar[Any] = None

    nodes: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    weights: Array = field(default_factory=lambda: np.empty(0))
    constant: Array = field(default_factory=lambda: np.zeros(3))
    start: Array = field(default_factory=lambda: np.zeros(3))
    is_place: bool = False
    holder: Any = None

    @property
    def averages(self) -> tuple[Average, ...]:
        """The averages that it depends on: itself."""
        return (self,)

    def value(self, means: Array) -> Array:
        """Its value, shape (3,), where its averages are at means, shape (1, 3)."""
        return np.asarray(means[0])

    def slopes(self, means: Array | None = None) -> Array:
        """Its derivatives by the displacements of its nodes, shape (nodes, 3, 3)."""
        return self.weights[:, None, None] * np.eye(3)


class FaceVector:
    """A point or a direction that follows the mean motion of a face.

    Attributes:
        arm: P - X̄, or the direction, at the start, shape (3,) [m, or 1].
        averages: The averages that it depends on: x̄ and the three H_k.
        weights: Those of the nodes in the middle of the face, Σ w = 1.
        local: Components of the arm along the axes a_k, shape (3,).
        start: Its value at the start, shape (3,).
    """

    def __init__(self, face: FaceSide, arm: Array, is_place: bool) -> None:
        """Take the data of its face."""
        self.face = self.holder = face
        self.arm, self.is_place, self.averages = arm, is_place, face.averages
        self.nodes, self.weights = face.nodes, face.averages[0].weights
        self.local: Array = arm @ face.axes
        self.start: Array = face.centre + arm if is_place else arm

    def in_body(self, centre: Array, products: Array) -> Array:
        """Its coefficients of [1, V] of a body, by V̄ [m] and Σ w (X - X̄) ⊗ V [m²], shape (4,)."""
        turned = nearest_rotations(products.T) @ self.arm
        return np.r_[1.0, centre + turned] if self.is_place else np.r_[0.0, turned]

    def value(self, means: Array) -> Array:
        """Its value, shape (3,), where its averages are at means, shape (4, 3)."""
        turned = self.local @ nearest_rotations(means[1:])
        return np.asarray(means[0] + turned if self.is_place else turned)

    def slopes(self, means: Array | None = None) -> Array:
        """Its derivatives by the displacements of its nodes, shape (nodes, 3, 3).

        Averages are those at the start if `means` are None.
        """
        r, turns = self.face.turns(means)
        moved = -skew(self.local @ r) @ turns
        return moved + self.averages[0].slopes() if self.is_place else moved


class Grounded:
    """The ground as a side: it does not move, and has no nodes, extent and mass of its own."""

    size = mass = np.inf
    nodes = np.empty(0, np.int64)

    def place(self, point: Array) -> Average:
        """The point itself."""
        return Average(constant=point, start=point, is_place=True)

    def direction(self, a: Array) -> Average:
        """The direction itself."""
        return Average(constant=a, start=a)


class Averages:
    """Nodes with weights as a side.

    Attributes:
        size: Root of the mean square of the nodes' distances to their centre [m].
        mass: Mass of the nodes [kg].
        nodes: Owned nodes of this rank.
        count: Number of nodes on all ranks.
        centre: Their mean place at the start [m].
        axes: Principal axes of the second moments, by columns, right-handed, the smallest moment
            first.
        moments: These moments over the square of the size, shape (3,).
    """

    def __init__(self, scene: Any, weights: Array, title: str) -> None:
        """Find centre and second moments, by w of each owned node in any unit. Collective.

        `SceneError` on every rank, if the nodes have no weight or lie on a line.
        """
        self.nodes = np.flatnonzero(weights)
        w, X = weights[self.nodes], scene.start_places[self.nodes]
        mass = scene.averaging_mass[self.nodes]
        sums = scene.sum(np.r_[w.sum(), w @ X, mass.sum(), self.nodes.size])
        self.count = int(sums[5])
        total = sums[0] if sums[0] > 0 else 1.0
        self.centre, self.mass = sums[1:4] / total, float(sums[4])
        self._w, self._arms = w / total, X - self.centre
        second = scene.sum((self._w[:, None] * self._arms).T @ self._arms)
        values, self.axes = np.linalg.eigh(second)
        self.axes[:, 0] *= np.linalg.det(self.axes)  # right-handed
        line = np.finfo(np.float64).eps ** (2 / 3)  # of the largest second moment
        if self.count < 3 or not sums[0] > 0 or not values[1] > line * values[2]:
            raise SceneError(
                f"{title}: a side of a joint needs nodes that span a plane at least; its "
                f"{self.count} with weight lie on a line. Name a larger set."
            )
        self.size = float(np.sqrt(np.trace(second)))
        self.moments: Array = values / self.size**2

    def _inverse(self, a: Array) -> Array:
        """W⁻¹ a."""
        return np.asarray(self.axes @ (a @ self.axes / (self.size**2 * self.moments)))

    def place(self, point: Array) -> Any:
        """Where a point of the side is by its affine mean."""
        arm = point - self.centre
        weights = self._w * (1.0 + self._arms @ self._inverse(arm))
        return Average(self.nodes, weights, start=point, is_place=True)

    def direction(self, a: Array) -> Any:
        """Where a direction of the side points by its affine mean."""
        return Average(self.nodes, self._w * (self._arms @ self._inverse(a)), start=a)


class FaceSide(Averages):
    """A face as a side, of which a body may hold all nodes; its averages are x̄ and the H_k."""

    def __init__(self, scene: Any, weights: Array, title: str) -> None:
        """See `Averages`. Collective."""
        super().__init__(scene, weights, title)
        middle = Average(self.nodes, self._w, start=self.centre, is_place=True)
        along = self._w[:, None] * (self._arms @ self.axes) / self.size**2
        self.averages = (middle, *(Average(self.nodes, own) for own in along.T))

    def place(self, point: Array) -> Vector:
        """Where a point of the side is."""
        arm = point - self.centre
        rounding = self.count * np.spacing(np.abs(self.centre).max() + self.size)
        return FaceVector(self, arm, True) if np.abs(arm).max() > rounding else self.averages[0]

    def direction(self, a: Array) -> Vector:
        """Where a direction of the side points."""
        return FaceVector(self, a, False)

    def within(self, scene: Any, bodies: Sequence[RigidBody]) -> tuple[int, Array, Array] | None:
        """The body that holds all nodes without deforming; None if there is none. Collective.

        Its number among the bodies, V̄ [m] and Σ w (X - X̄) ⊗ V [m²].
        """
        local = np.zeros((len(bodies), 1 + 3 + 9))
        for out, body in zip(local, bodies, strict=True):
            if body.shapes is not None:
                continue
            at = np.minimum(np.searchsorted(body.nodes, self.nodes), max(body.nodes.size - 1, 0))
            here = body.nodes[at] == self.nodes if body.nodes.size else np.zeros(at.size, bool)
            w, V = self._w[here, None], body.offsets[at[here]]
            out[0], out[1:4] = np.count_nonzero(here), (w * V).sum(axis=0)
            out[4:] = ((w * self._arms[here]).T @ V).reshape(-1)
        sums = np.asarray(scene.sum(local))
        found = np.flatnonzero(sums[:, 0] == self.count)
        if not found.size:
            return None
        own = sums[found[0]]
        return int(found[0]), own[1:4], own[4:].reshape(3, 3)

    def turns(self, means: Array | None = None) -> tuple[Array, Array]:
        """The axes r_k by rows, and derivatives of θ by displacements of the nodes, (nodes, 3, 3).

        Averages are those at the start if `means` are None.
        """
        r = self.axes.T if means is None else nearest_rotations(means[1:])
        H = self.moments[:, None] * r if means is None else means[1:]
        weights = np.stack([average.weights for average in self.averages[1:]], axis=1)
        return r, np.einsum("nk,akb->nab", weights, turn_map(r, H))

    def unit_loads(self) -> Array:
        """Forces by unit forces and couples along x, y, z at the start, shape (nodes, 3, 6) [N]."""
        forces, couples = self.averages[0].slopes(), self.turns()[1]
        return np.concatenate([forces, couples], axis=1).swapaxes(1, 2)


Vector = Average | FaceVector
Sided = Averages | Grounded


def turn_map(r: Array, H: Array) -> Array:
    """θ by δH, -N⁻¹ c(r, ·) of (2), by axes r and H_k in rows, shape (..., 3, 3, 3)."""
    c = np.moveaxis(skew(r.swapaxes(-1, -2)), -3, -1)
    N = np.einsum("...jka,...kab->...jb", c, skew(H))
    return -np.linalg.solve(N, c.reshape(*N.shape[:-1], 9)).reshape(c.shape)


def value_at(scene: Any, vector: Vector, x: Array) -> Array:
    """A vector where owned nodes are at x, shape (nodes, 3) [m]. Collective."""
    return motion_at(scene, vector, x, np.zeros_like(x))[0]


def motion_at(scene: Any, vector: Vector, x: Array, v: Array) -> tuple[Array, Array]:
    """A vector and its rate where nodes are at x and move with v, shape (3,) each. Collective."""
    means = np.array([a.weights @ x[a.nodes] for a in vector.averages])
    means = np.asarray(scene.sum(means)) + [a.constant for a in vector.averages]
    rate = np.einsum("nij,nj->i", vector.slopes(means), v[vector.nodes])
    return vector.value(means), np.asarray(scene.sum(rate))

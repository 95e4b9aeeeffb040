"""Mean motion of a face: its centre, and the rotation that fits its nodes best.

The nodes of a face have weights w, Σ w = 1, and places X at the start. With the principal axes a_k
of Σ w (X - X̄) ⊗ (X - X̄) and the size s of the face,

    x̄ = Σ w x,    H_k = Σ w (X - X̄)·a_k x / s²

are linear in the places x of the nodes. The rotation R makes Σ w |x - x̄ - R (X - X̄)|² least: it is
the rotation of a distributing coupling (RBE3). Its axes r_k = R a_k are those for which

    c_j = r_i · H_k - r_k · H_i = 0,    (j, i, k) cyclic.                                       (1)

A point P of the face is at x̄ + R (P - X̄), a direction a points along R a. Both are known of flat
faces, too, where H_k is zero along the normal. Where one body holds all nodes, those of a rigid
face always, both are linear in the body's pose: with V the places in its frame,

    V̄ + Q (P - X̄)  a point P,     Q a  a direction a,     Q the rotation that fits Σ w (X - X̄) ⊗ V.

The c_j are bilinear. In a step r and H change from r₀, H₀ to r₁, H₁, and Δr_k = θ × r½_k with the
Cayley vector θ and r½ = ½ (r₀ + r₁). As c_j = 0 at both ends, exactly

    N θ = -c(r½, ΔH),    N_j = r½_i × H½_k - r½_k × H½_i,                                       (2)

where c(r, δH) has δH in place of H. So Δ(R a) = θ × (R a)½, and θ is linear in ΔH. A couple M of
the face acts on the H_k by forces that do the work M · θ exactly. They have the moment M about any
point, since δH_k = ω × H½_k gives θ = ω.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.effects.joints.averages import Average, Averages, Grounded
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import cross, nearest_rotations, skew

__all__ = [
    "FaceSide",
    "FaceVector",
    "Sided",
    "Vector",
    "cyclic",
    "motion_at",
    "turn_map",
    "value_at",
]


def cyclic() -> list[tuple[int, int, int]]:
    """The numbers j, i, k of (1)."""
    return [(j, (j + 1) % 3, (j + 2) % 3) for j in range(3)]


def turn_map(r: Array, H: Array) -> tuple[Array, Array]:
    """N⁻¹, shape (..., 3, 3), and θ by δH, -N⁻¹ c(r, ·), shape (..., 3, 3, 3): (2).

    Args:
        r: Axes by rows, shape (..., 3, 3).
        H: H_k by rows, likewise.
    """
    N, c = np.empty(r.shape), np.zeros((*r.shape, 3))
    for j, i, k in cyclic():
        N[..., j, :] = cross(r[..., i, :], H[..., k, :]) - cross(r[..., k, :], H[..., i, :])
        c[..., j, k, :] = r[..., i, :]
        c[..., j, i, :] = -r[..., k, :]
    inverse: Array = np.asarray(np.linalg.inv(N), dtype=np.float64)
    return inverse, np.asarray(-np.einsum("...aj,...jkb->...akb", inverse, c))


class FaceSide(Averages):
    """A face as a side, of which a body may hold all nodes; those of a rigid face always.

    Attributes:
        averages: x̄ and the three H_k.
    """

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
        """The body that holds all nodes without deforming, and how. Collective.

        Args:
            scene: The problem.
            bodies: The bodies.

        Returns:
            Its number among the bodies, V̄ [m] and Σ w (X - X̄) ⊗ V [m²]; None if no body holds
            all nodes.
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
        """The axes r_k by rows, and derivatives of θ by the displacements of the nodes.

        Args:
            means: Values of the averages; those at the start if None.

        Returns:
            Shapes (3, 3) and (nodes, 3, 3).
        """
        r = self.axes.T if means is None else nearest_rotations(means[1:])
        H = self.moments[:, None] * r if means is None else means[1:]
        weights = np.stack([average.weights for average in self.averages[1:]], axis=1)
        return r, np.einsum("nk,akb->nab", weights, turn_map(r, H)[1])

    def unit_loads(self) -> Array:
        """Forces on the nodes by unit forces and couples along x, y and z, at the start.

        Returns:
            Shape (nodes, 3, 6) [N].
        """
        forces, couples = self.averages[0].slopes(), self.turns()[1]
        return np.concatenate([forces, couples], axis=1).swapaxes(1, 2)


@dataclass(frozen=True, eq=False)
class FaceVector:
    """A point or a direction that follows the mean motion of a face.

    Attributes:
        face: The face.
        arm: P - X̄, or the direction, at the start, shape (3,) [m, or 1].
        is_place: Whether it is a point.
    """

    face: FaceSide
    arm: Array
    is_place: bool

    @property
    def holder(self) -> FaceSide:
        """Finds the body that it may be fixed to."""
        return self.face

    def in_body(self, centre: Array, products: Array) -> Array:
        """Its coefficients of [1, V] of a body that holds the face, shape (4,).

        Args:
            centre: V̄ [m].
            products: Σ w (X - X̄) ⊗ V [m²].
        """
        turned = nearest_rotations(products.T) @ self.arm
        return np.r_[1.0, centre + turned] if self.is_place else np.r_[0.0, turned]

    @property
    def start(self) -> Array:
        """Its value at the start, shape (3,)."""
        return self.face.centre + self.arm if self.is_place else self.arm

    @property
    def nodes(self) -> Ints:
        """Owned nodes of this rank."""
        return self.face.nodes

    @property
    def averages(self) -> tuple[Average, ...]:
        """The averages that it depends on: x̄ and the three H_k."""
        return self.face.averages

    @property
    def weights(self) -> Array:
        """Weights of the nodes in the middle of the face, Σ w = 1."""
        return self.face.averages[0].weights

    @property
    def local(self) -> Array:
        """Components of the arm along the axes a_k, shape (3,)."""
        return np.asarray(self.arm @ self.face.axes)

    def value(self, means: Array) -> Array:
        """Its value, shape (3,).

        Args:
            means: Values of its averages, shape (4, 3).
        """
        turned = self.local @ nearest_rotations(means[1:])
        return np.asarray(means[0] + turned if self.is_place else turned)

    def slopes(self, means: Array | None = None) -> Array:
        """Its derivatives by the displacements of its nodes, shape (nodes, 3, 3).

        Args:
            means: Values of its averages; those at the start if None.
        """
        r, turns = self.face.turns(means)
        moved = -skew(self.local @ r) @ turns
        return moved + self.averages[0].slopes() if self.is_place else moved


Vector = Average | FaceVector
Sided = Averages | Grounded


def _means_at(scene: Any, vector: Vector, x: Array) -> Array:
    """Averages of a vector where nodes are at x, shape (averages, 3). Collective."""
    constant = [a.constant for a in vector.averages]
    return np.asarray(scene.sum([a.weights @ x[a.nodes] for a in vector.averages]) + constant)


def value_at(scene: Any, vector: Vector, x: Array) -> Array:
    """A vector where nodes are at x, shape (3,). Collective.

    Args:
        scene: The problem.
        vector: The vector.
        x: Places of owned nodes, shape (nodes, 3) [m].
    """
    return vector.value(_means_at(scene, vector, x))


def motion_at(scene: Any, vector: Vector, x: Array, v: Array) -> tuple[Array, Array]:
    """A vector and its rate where nodes are at x and move with v, shape (3,) each. Collective."""
    means = _means_at(scene, vector, x)
    rate = np.einsum("nij,nj->i", vector.slopes(means), v[vector.nodes])
    return vector.value(means), np.asarray(scene.sum(rate))

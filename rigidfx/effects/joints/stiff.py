"""Points and directions of faces, as a body has them that holds all nodes of the face.

The nodes of a rigid face move as one body: one of their own, or one that holds them all, as it may
hold those of a mean face. With w their weights, Σ w = 1, X their places at the start and V those in
the body's frame,

    V̄ + Q (P - X̄)  a point P,     Q a  a direction a,     Q the rotation that fits Σ w (X - X̄) ⊗ V.

That is the mean motion of the face (`face_motion`), but linear in the body's pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.mechanics.rotation import nearest_rotations

__all__ = ["BodyVector", "Stiff", "StiffNodes", "StiffRow", "stiff_rows", "weights_of"]

Array = npt.NDArray[np.float64]


class StiffNodes:
    """The nodes of a face.

    Attributes:
        centre: X̄ [m].
    """

    def __init__(
        self, nodes: npt.NDArray[np.int64], w: Array, arms: Array, centre: Array, count: int
    ) -> None:
        """Take them.

        Args:
            nodes: Owned nodes of this rank, sorted.
            w: Weight of each.
            arms: X - X̄ of each, shape (nodes, 3) [m].
            centre: X̄ [m].
            count: Number of nodes on all ranks.
        """
        self._nodes, self._w, self._arms, self._size = nodes, w, arms, count
        self.centre = centre

    def within(self, scene: Any, bodies: Sequence[RigidBody]) -> tuple[int, Array, Array] | None:
        """The body that holds all of them without deforming, and how. Collective.

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
            at = np.minimum(np.searchsorted(body.nodes, self._nodes), max(body.nodes.size - 1, 0))
            here = body.nodes[at] == self._nodes if body.nodes.size else np.zeros(at.size, bool)
            w, V = self._w[here, None], body.offsets[at[here]]
            out[0], out[1:4] = np.count_nonzero(here), (w * V).sum(axis=0)
            out[4:] = ((w * self._arms[here]).T @ V).reshape(-1)
        sums = np.asarray(scene.sum(local))
        found = np.flatnonzero(sums[:, 0] == self._size)
        if not found.size:
            return None
        own = sums[found[0]]
        return int(found[0]), own[1:4], own[4:].reshape(3, 3)


@dataclass(frozen=True)
class Stiff:
    """A point or a direction of a face.

    Attributes:
        nodes: The nodes of the face.
        vector: The point at the start [m], or the direction there, shape (3,).
        is_place: Whether it is a point.
    """

    nodes: StiffNodes
    vector: Array
    is_place: bool

    def coordinates(self, centre: Array, products: Array) -> Array:
        """Its coefficients of [1, V] of the body, shape (4,).

        Args:
            centre: V̄ [m].
            products: Σ w (X - X̄) ⊗ V [m²].
        """
        Q = nearest_rotations(products.T)
        if not self.is_place:
            return np.r_[0.0, Q @ self.vector]
        return np.r_[1.0, centre + Q @ (self.vector - self.nodes.centre)]


@dataclass(frozen=True)
class BodyVector:
    """The origin or a direction of the body of a name, as the vectors of faces are found.

    Attributes:
        name: Name of the body.
        direction: Direction in its frame; None for its origin.
    """

    name: str
    direction: tuple[float, ...] | None = None

    @property
    def nodes(self) -> BodyVector:
        """What finds the body."""
        return self

    def within(self, scene: Any, bodies: Sequence[RigidBody]) -> tuple[int, Array, Array] | None:
        """See `StiffNodes`."""
        numbers = [k for k, body in enumerate(bodies) if body.name == self.name]
        return (numbers[0], np.zeros(3), np.eye(3)) if numbers else None

    def coordinates(self, centre: Array, products: Array) -> Array:
        """See `Stiff`."""
        return np.r_[1.0, centre] if self.direction is None else np.r_[0.0, self.direction]


@dataclass(frozen=True)
class StiffRow:
    """How a vector follows a body.

    Attributes:
        row: Its coefficients of [1, V] of all bodies, shape (bodies, 4).
        body: Number of the body.
        products: Σ w (X - X̄) ⊗ V of the face, shape (3, 3) [m²].
    """

    row: Array
    body: int
    products: Array


def stiff_rows(
    scene: Any, bodies: Sequence[RigidBody], vectors: Sequence[Any]
) -> dict[int, StiffRow]:
    """How vectors of faces that a body holds, and of carried masses, follow it. Collective.

    Args:
        scene: The problem.
        bodies: The bodies.
        vectors: Averages and vectors of faces.

    Returns:
        By the number of the vector.
    """
    out: dict[int, StiffRow] = {}
    known: dict[StiffNodes | BodyVector, tuple[int, Array, Array] | None] = {}
    for k, vector in enumerate(vectors):
        stiff: Stiff | BodyVector | None = vector.stiff
        if stiff is None:
            continue
        if stiff.nodes not in known:
            known[stiff.nodes] = stiff.nodes.within(scene, bodies)
        if (found := known[stiff.nodes]) is not None:
            row = np.zeros((len(bodies), 4))
            row[found[0]] = stiff.coordinates(*found[1:])
            out[k] = StiffRow(row, found[0], found[2])
    return out


def weights_of(
    scene: Any, bodies: Sequence[RigidBody], averages: Sequence[Any], stiff: Mapping[int, StiffRow]
) -> tuple[csr_array, csr_array]:
    """How averages follow nodes and bodies. Collective.

    Args:
        scene: The problem.
        bodies: The bodies.
        averages: The averages.
        stiff: Rows of the averages of faces that a body holds: see `stiff_rows`.

    Returns:
        Weights of owned nodes, shape (averages, nodes), those of faces that a body holds left out,
        and of the bodies' a = [1, V, Φ₁, ..., Φ_m], shape (averages, n · bodies).
    """
    own = [a.nodes[: 0 if k in stiff else None] for k, a in enumerate(averages)]
    number = np.repeat(np.arange(len(own)), [some.size for some in own])
    values = [a.weights[: some.size] for a, some in zip(averages, own, strict=True)]
    at = number, np.concatenate([np.empty(0, np.int64), *own])
    shape = len(own), scene.owned_nodes
    W = csr_array((np.concatenate([np.empty(0), *values]), at), shape=shape)
    n = 4 + 3 * max((body.deforms_by for body in bodies), default=0)
    held = np.zeros((len(own), len(bodies), n))
    for k, body in enumerate(bodies):
        held[:, k, : 4 + 3 * body.deforms_by] = W[:, body.nodes] @ body.coordinates()
    every = np.asarray(scene.sum(held))
    for k, row in stiff.items():
        every[k, :, :4] = row.row
    return W, csr_array(every.reshape(len(own), -1))

"""Places and directions of a joint's sides that are linear in the places of nodes.

A side is a set of nodes with weights w. Its mean place and its affine mean are

    x̄ = Σ w x / Σ w,    F̄ = Σ w x ⊗ (X - X̄) W⁻¹,    W = Σ w (X - X̄) ⊗ (X - X̄),

X the places at the start. A point p of a rigid part is at x̄ + F̄ (p - X̄), a direction a points along
F̄ a: both are Σ c x with constant c, and the point and the direction themselves while the part is
rigid. A mean face shears: its directions turn with it, see `face_motion`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Ints

__all__ = ["Average", "Averages", "Grounded"]

NONE = np.empty(0)


@dataclass(frozen=True)
class Average:
    """A vector that is Σ c x over nodes of all ranks, and a constant.

    Attributes:
        nodes: Owned nodes of this rank.
        weights: c of each [1, or 1/m].
        constant: Shape (3,).
        start: Its value at the start, shape (3,).
        is_place: Whether it is a place, not a direction.
    """

    nodes: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    weights: Array = field(default_factory=lambda: NONE)
    constant: Array = field(default_factory=lambda: np.zeros(3))
    start: Array = field(default_factory=lambda: np.zeros(3))
    is_place: bool = False

    @property
    def face(self) -> Any:
        """The face that it turns with; None if it is but linear."""
        return None

    @property
    def holder(self) -> Any:
        """Finds the body that it may be fixed to, as `FaceSide` does; None if none is asked for."""
        return None

    @property
    def averages(self) -> tuple[Average, ...]:
        """The averages that it depends on: itself."""
        return (self,)

    def value(self, means: Array) -> Array:
        """Its value, shape (3,).

        Args:
            means: Values of its averages, shape (1, 3).
        """
        return np.asarray(means[0])

    def slopes(self, means: Array | None = None) -> Array:
        """Its derivatives by the displacements of its nodes, shape (nodes, 3, 3).

        Args:
            means: Values of its averages; those at the start if None.
        """
        return self.weights[:, None, None] * np.eye(3)


class Grounded:
    """The ground as a side: it does not move.

    Attributes:
        size: Its extent [m]: none of its own.
        mass: Mass that moves with it [kg].
        nodes: It has none.
    """

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
        """Find centre and second moments. Collective.

        Args:
            scene: The problem.
            weights: w of each owned node, in any unit.
            title: Name of the side, for messages.

        Raises:
            SceneError: On every rank, if the nodes have no weight or lie on a line.
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

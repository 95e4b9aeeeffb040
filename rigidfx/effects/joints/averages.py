"""Places and directions of a joint's sides: averages that are linear in the places of nodes.

A side is a set of nodes with weights w. Its mean place and its affine mean are

    x̄ = Σ w x / Σ w,    F̄ = Σ w x ⊗ (X - X̄) W⁻¹,    W = Σ w (X - X̄) ⊗ (X - X̄),

X the places at the start. A point p of the side is at x̄ + F̄ (p - X̄), a direction a points along
F̄ a: both are Σ c x with constant c, so that products of them are quadratic in nodal places. On a
rigid part they are the point and the direction themselves. Nodes in one plane know no direction
across it: W⁻¹ is the pseudo-inverse then.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects.joints.stiff import Stiff, StiffNodes

__all__ = ["Average", "Averages", "Face", "Grounded", "Sided", "StiffFace"]

Array = npt.NDArray[np.float64]
NONE = np.empty(0)

FLAT = 1e-10  # of the largest second moment: what nodes in a plane, or on a line, have across it
OFF = 1e-6  # of its own size, by which a point or direction may lie out of what nodes know


@dataclass(frozen=True)
class Average:
    """A vector that is Σ c x over nodes of all ranks, and a constant.

    Attributes:
        nodes: Owned nodes of this rank.
        weights: c of each [1, or 1/m].
        constant: Shape (3,).
        is_place: Whether it is a place, not a direction.
        stiff: How it follows the nodes of a rigid face while these are in one body; None if it is
            of no rigid face.
    """

    nodes: npt.NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    weights: Array = field(default_factory=lambda: NONE)
    constant: Array = field(default_factory=lambda: np.zeros(3))
    is_place: bool = False
    stiff: Stiff | None = None


class Grounded:
    """The ground as a side: it does not move.

    Attributes:
        size: Its extent [m]: none of its own.
        mass: Mass that moves with it [kg].
        nodes: It has none.
    """

    size = mass = np.inf
    nodes = np.empty(0, np.int64)

    def knows(self, direction: Array) -> bool:
        """Whether it has such a direction: any."""
        return True

    def place(self, point: Array) -> Average:
        """The point itself."""
        return Average(constant=point, is_place=True)

    def direction(self, a: Array) -> Average:
        """The direction itself."""
        return Average(constant=a)


class Averages:
    """Nodes with weights as a side.

    Attributes:
        size: Root of the mean square of the nodes' distances to their centre [m].
        mass: Mass of the nodes [kg].
        nodes: Owned nodes of this rank.
        centre: Their mean place at the start [m].
    """

    def __init__(self, scene: Any, weights: Array, title: str) -> None:
        """Find centre and second moments. Collective.

        Args:
            scene: The problem.
            weights: w of each owned node, in any unit.
            title: Name of the side, for messages.

        Raises:
            SceneError: On every rank, if the nodes have no weight or lie in one point.
        """
        self._title = title
        self.nodes = np.flatnonzero(weights)
        w, X = weights[self.nodes], scene.start_places[self.nodes]
        mass = scene.averaging_mass[self.nodes]
        sums = scene.sum(np.r_[w.sum(), w @ X, mass.sum(), self.nodes.size])
        if sums[5] < 2 or not sums[0] > 0:
            raise SceneError(
                f"{title}: a side of a joint needs nodes that span a line at least, and has "
                f"{int(sums[5])} with weight. Name a larger set."
            )
        self.centre, self.mass = sums[1:4] / sums[0], float(sums[4])
        self._w, self._arms = w / sums[0], X - self.centre
        second = scene.sum((self._w[:, None] * self._arms).T @ self._arms)
        self.size = float(np.sqrt(np.trace(second)))
        values, axes = np.linalg.eigh(second)
        seen = values > FLAT * values[2]
        self._across = axes[:, ~seen]
        self._inverse = (axes[:, seen] / values[seen]) @ axes[:, seen].T

    def knows(self, direction: Array) -> bool:
        """Whether the nodes span a direction."""
        return bool(np.linalg.norm(direction @ self._across) <= OFF * np.linalg.norm(direction))

    def holds(self, point: Array) -> bool:
        """Whether the nodes span the place of a point."""
        return bool(np.linalg.norm((point - self.centre) @ self._across) <= OFF * self.size)

    @property
    def flat(self) -> bool:
        """Whether the nodes lie in a plane or on a line."""
        return self._across.size > 0

    def place(self, point: Array) -> Average:
        """Where a point of the side is.

        Raises:
            SceneError: If the nodes lie in a plane or on a line, and the point beside it.
        """
        arm = point - self.centre
        if not self.holds(point):
            raise SceneError(
                f"{self._title}: its nodes lie in a plane or on a line, and the joint at "
                f"{point} m beside it, {np.linalg.norm(arm @ self._across):.3g} m away. Place the "
                "joint there, or name a set that is not flat."
            )
        weights = self._w * (1.0 + self._arms @ (self._inverse @ arm))
        return Average(self.nodes, weights, is_place=True)

    def direction(self, a: Array) -> Average:
        """Where a direction of the side points.

        Raises:
            SceneError: If the nodes do not span it.
        """
        if not self.knows(a):
            raise SceneError(
                f"{self._title}: its nodes lie in a plane or on a line, and know no direction "
                f"{a}. Name a set that is not flat."
            )
        return Average(self.nodes, self._w * (self._arms @ (self._inverse @ a)))


class Face:
    """A flat surface as a side: cells behind it span the directions that its nodes do not.

    Attributes:
        size: That of the surface [m].
        mass: Mass of the nodes of the cells behind it [kg].
        nodes: Owned nodes of the surface on this rank.
        centre: Their mean place at the start [m].
    """

    def __init__(self, surface: Averages, behind: Averages) -> None:
        """Take both.

        Args:
            surface: Nodes of the surface.
            behind: Nodes of the cells that have it.
        """
        self._surface, self._behind = surface, behind
        self.size, self.mass = surface.size, behind.mass
        self.nodes, self.centre = surface.nodes, surface.centre

    def knows(self, direction: Array) -> bool:
        """Whether the nodes span a direction."""
        return self._behind.knows(direction)

    def holds(self, point: Array) -> bool:
        """Whether the nodes of the surface span the place of a point."""
        return self._surface.holds(point)

    def place(self, point: Array) -> Average:
        """Where a point of the side is."""
        return (self._surface if self.holds(point) else self._behind).place(point)

    def direction(self, a: Array) -> Average:
        """Where a direction of the side points."""
        return (self._surface if self._surface.knows(a) else self._behind).direction(a)


class StiffFace:
    """A rigid face as a side: a point or a direction of the body that holds its nodes.

    Attributes:
        size: That of the surface [m].
        mass: Mass of its nodes, or of those of the cells behind it where it is flat [kg].
        nodes: Owned nodes of the surface on this rank.
        centre: Their mean place at the start [m].
    """

    def __init__(self, scene: Any, weights: Array, side: Averages | Face) -> None:
        """Take the nodes. Collective.

        Args:
            scene: The problem.
            weights: Weight of each owned node.
            side: The surface as a mean face, which serves while its nodes are in no body.
        """
        self._side, self._nodes = side, StiffNodes(scene, weights)
        self.size, self.mass, self.nodes, self.centre = (
            side.size,
            side.mass,
            side.nodes,
            side.centre,
        )

    def knows(self, direction: Array) -> bool:
        """Whether it has such a direction: any."""
        return True

    def holds(self, point: Array) -> bool:
        """Whether the nodes of the surface span the place of a point."""
        return not isinstance(self._side, Face) or self._side.holds(point)

    def place(self, point: Array) -> Average:
        """Where a point of the side is."""
        return replace(self._side.place(point), stiff=Stiff(self._nodes, point, True))

    def direction(self, a: Array) -> Average:
        """Where a direction of the side points."""
        return replace(self._side.direction(a), stiff=Stiff(self._nodes, a, False))


Sided = Averages | Face | StiffFace | Grounded

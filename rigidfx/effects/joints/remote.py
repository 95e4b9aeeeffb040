"""Points of faces and mean places of sets, seen as `rigidfx.effects.nodes` shows nodes.

The joints of a division know where they are and spread forces on them over nodes and bodies: such
points are among the averages of `Linkage`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.effects.action import Structure
from rigidfx.effects.joints.face_motion import Vector

__all__ = ["RemoteForces", "RemoteMotion", "RemoteNodes", "RemoteTangent"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class RemoteMotion:
    """An iterate, or with increments of zero a state.

    Attributes:
        places: Where all averages are at the start of the step, shape (averages, 3) [m].
        moved: Their increments, likewise.
        dt: Length of the step [s]; of no meaning in statics.
    """

    places: Array
    moved: Array
    dt: float

    @property
    def start(self) -> RemoteMotion:
        """The start of the step."""
        return self


@dataclass(frozen=True)
class RemoteForces:
    """Forces on all averages.

    Attributes:
        averages: Shape (averages, 3) [N].
    """

    averages: Array


@dataclass
class RemoteTangent:
    """Takes derivatives of forces on averages.

    Attributes:
        size: Number of averages.
        own: Rows, columns and values of each action.
    """

    size: int
    own: list[tuple[Ints, Ints, Array]] = field(default_factory=list)

    def matrix(self) -> csr_array:
        """All of them, shape (3 · averages,) * 2 [N/m]."""
        none = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
        row, column, value = map(np.concatenate, zip(none, *self.own, strict=True))
        return csr_array((value, (row, column)), shape=(3 * self.size,) * 2)


class RemoteNodes:
    """Some averages as nodes; arrays are equal on all ranks, and have one row for each.

    Attributes:
        ends: The averages.
        weights: 1 of each, shape (nodes,).
        share: Part of a step at whose end forces are: one half, or all in statics.
    """

    def __init__(
        self, structure: Structure, ends: Sequence[Vector], rest: Array | float = 0.0
    ) -> None:
        """Take them.

        Args:
            structure: The division.
            ends: The averages.
            rest: Where each is without displacement, shape (nodes, 3) [m].
        """
        self.ends, self._rest = tuple(ends), rest
        self.weights = np.ones(len(self.ends))
        self.share = 1.0 if structure.static else 0.5
        self._at = slice(0, len(self.ends))

    def number(self, first: int) -> int:
        """Have the first one's number among all averages; that of the next ones."""
        self._at = slice(first, first + len(self.ends))
        return self._at.stop

    def far(self) -> float:
        """Largest coordinate of one of them at the start of a run [m]."""
        return float(max(np.abs(end.start).max() for end in self.ends))

    def positions(self, at: RemoteMotion) -> Array:
        """Positions, or directions, shape (nodes, 3) [m]."""
        return at.places[self._at]

    def displacement(self, at: RemoteMotion) -> Array:
        """Displacements from `rest`, likewise [m]."""
        return np.asarray(at.places[self._at] - self._rest)

    def moved(self, motion: RemoteMotion) -> Array:
        """Increments at an iterate, likewise [m]."""
        return motion.moved[self._at]

    start = displacement

    def add(self, force: Array, forces: RemoteForces) -> None:
        """Add forces on them, shape (nodes, 3) [N]."""
        forces.averages[self._at] += force

    def stiffen(self, blocks: Array, tangent: RemoteTangent) -> None:
        """Add the stiffness of each by itself, shape (nodes, 3, 3) [N/m]."""
        n = len(self.ends)
        every = np.zeros((n, 3, n, 3))
        every[np.arange(n), :, np.arange(n)] = blocks
        self.couple(every, tangent)

    def couple(self, blocks: Array, tangent: RemoteTangent) -> None:
        """Add the derivative of forces on each by each, shape (nodes, 3, nodes, 3) [N/m]."""
        n = 3 * len(self.ends)
        numbers = 3 * self._at.start + np.arange(n)
        tangent.own.append((np.repeat(numbers, n), np.tile(numbers, n), blocks.ravel()))

"""Points of faces and mean places of sets, seen as `rigidfx.effects.nodes` shows nodes.

The joints of a division know where they are and spread forces on them over nodes and bodies: such
points are among the vectors of `Linkage`. `Points` are the actions on them: torques, springs,
masses, cables, and a user's own. Forces are an array over all vectors, shape (vectors, 3) [N]; a
tangent is a list of rows, columns and values, to which each action adds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.joints.averages import Vector

__all__ = ["Points", "RemoteMotion", "RemoteNodes", "RemoteTangent"]

Heed = Callable[[Action, str], Callable[..., Any]]
RemoteTangent = list[tuple[Ints, Ints, Array]]


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
        """See some averages as nodes.

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
        """Give the first one its number among all vectors; the number after the last one."""
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

    def add(self, force: Array, forces: Array) -> None:
        """Add forces on them, shape (nodes, 3) [N]."""
        forces[self._at] += force

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
        tangent.append((np.repeat(numbers, n), np.tile(numbers, n), blocks.ravel()))


class Points:
    """Actions whose `nodes` are remote; their averages come after those of the joints.

    Attributes:
        rounding: Size of a force that the machine precision is to be multiplied with [N].
    """

    def __init__(self, actions: Sequence[Action], heed: Heed = getattr) -> None:
        """Find their methods.

        Args:
            actions: The actions.
            heed: Makes a function of a method of an action that keeps a user's exceptions.
        """
        self._actions = tuple(actions)
        self.rounding = sum(action.rounding for action in actions)
        self._resist, self._stiffen, self._taken, self._stored, self._accept = (
            [heed(action, method) for action in self._actions]
            for method in ("resist", "stiffen", "taken", "stored", "accept")
        )

    def number(self, first: int) -> list[Vector]:
        """The averages of all actions, whose first one has this number."""
        for action in self._actions:
            first = action.nodes.number(first)
        none: Array = np.zeros((first, 3))
        self._motion = RemoteMotion(none, none, 1.0)
        return [end for action in self._actions for end in action.nodes.ends]

    def __len__(self) -> int:
        """How many actions there are."""
        return len(self._actions)

    def set_time(self, t: float, dt: float) -> None:
        """See `Action`."""
        for action in self._actions:
            action.set_time(t, dt)

    def look(self, start: Array, moved: Array, dt: float) -> None:
        """See an iterate: averages of joints and points at the start, and their increments."""
        self._motion = RemoteMotion(start, moved, dt)

    def add_to(self, forces: Array) -> None:
        """Add resistances to forces on all averages, shape (averages, 3) [N]."""
        for resist in self._resist:
            resist(self._motion, forces)

    def stiffness(self) -> csr_array:
        """Their derivatives by all averages, shape (3 · averages,) * 2 [N/m]."""
        none, size = np.empty(0, np.int64), 3 * len(self._motion.places)
        tangent: RemoteTangent = [(none, none, np.empty(0))]
        for stiffen in self._stiffen:
            stiffen(self._motion, tangent)
        row, column, value = map(np.concatenate, zip(*tangent, strict=True))
        return csr_array((value, (row, column)), shape=(size, size))

    def told(self) -> dict[str, Any]:
        """Reports of the actions that have a title, of the last step, by title."""
        return {a.title: a.told(self._motion) for a in self._actions if a.title}

    def work(self) -> tuple[float, dict[str, float]]:
        """Work of loads in the step, and loss by dampers by their kind [J]."""
        done, lost = 0.0, dict[str, float]()
        for action, taken in zip(self._actions, self._taken, strict=True):
            energy = taken(self._motion)
            if not action.dissipates:
                done -= energy
            elif energy:
                lost[action.kind] = lost.get(action.kind, 0.0) + energy
        return done, lost

    def accept(self) -> None:
        """See `Action`."""
        for accept in self._accept:
            accept()

    def stored(self, p: Array) -> float:
        """Energy of springs where all averages are at p [J]."""
        at = RemoteMotion(p, np.zeros_like(p), 1.0)
        return float(sum(stored(at) for stored in self._stored))

"""Actions on remote points: torques, springs, masses, cables, and a user's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.effects.action import Action
from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.remote import RemoteForces, RemoteMotion, RemoteTangent

__all__ = ["Points"]

Array = npt.NDArray[np.float64]
Heed = Callable[[Action, str], Callable[..., Any]]


def _plain(action: Action, method: str) -> Callable[..., Any]:
    """A method as it is."""
    return getattr(action, method)


class Points:
    """Actions whose `nodes` are remote; their averages come after those of the joints.

    Attributes:
        rounding: Size of a force that the machine precision is to be multiplied with [N].
    """

    def __init__(self, actions: Sequence[Action], heed: Heed = _plain) -> None:
        """Take actions over.

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
            resist(self._motion, RemoteForces(forces))

    def stiffness(self) -> csr_array:
        """Their derivatives by all averages, shape (3 · averages,) * 2 [N/m]."""
        tangent = RemoteTangent(len(self._motion.places))
        for stiffen in self._stiffen:
            stiffen(self._motion, tangent)
        return tangent.matrix()

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

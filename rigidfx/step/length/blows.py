"""The error of an impulse, as the force of a contact changes within a step.

The motion of a probe hardly shows this error at first: an impulse that is too large causes a small
error during the contact, and a growing one afterwards. A step takes the force at its middle for the
mean force, so the error of the impulse is

    Δt³/24 F'' ≈ Δt/24 |F - F*| ,

with F* the force that a line through the two steps before gives. Divided by the whole mass this is
an error of velocity, and after the time U/V an error of displacement, with U the largest
displacement and V the largest speed so far. It counts for this time after the closing of a contact
that was open for some steps. Contacts that rest or rattle send nothing off, and do not count.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Contact, Touch
from rigidfx.scene.scene import Scene

__all__ = ["Blows"]

Array = npt.NDArray[np.float64]

LONGER = 4.0  # times a step: the force in one so long tells nothing of that at its ends
SETTLED = 4  # steps that a contact has been open before it closes with a blow


class Forces(NamedTuple):
    """Of contacts at the middle t of a step: three components and the pressing force, by titles."""

    t: float
    dt: float
    of: Mapping[str, Array]


class Blows:
    """Follows the forces of contacts.

    Attributes:
        any: Whether there are contacts.
    """

    remembered: ClassVar[Remembered] = same("_known", "_open", "_begun", "_fastest")

    def __init__(self, scene: Scene) -> None:
        """Nothing touches. Collective."""
        self.any = bool(scene.named(Contact))
        self._mass = float(scene.sum(scene.nodal_mass[: scene.owned_nodes].sum()))
        self._known: tuple[Forces, ...] = ()  # of the last two steps
        self._next, self._speed = Forces(0.0, 0.0, {}), 0.0
        self._open: dict[str, int] = {}  # steps that each contact has been open
        self._begun: dict[str, float] = {}  # when the last blow of each began [s]
        self._fastest = 0.0

    def look(
        self, touches: Mapping[str, Touch], t: float, dt: float, size: float, speed: float
    ) -> float:
        """By how much a step that has been solved errs once it shows [m].

        Args:
            touches: Effects of contacts in it.
            t: Time at its start [s].
            dt: Its length [s].
            size: U, the largest displacement so far [m].
            speed: The largest speed at its end [m/s].
        """
        self._speed = max(self._fastest, speed)
        forces = {title: np.array([*a.force, a.pressing]) for title, a in touches.items()}
        self._next, off = Forces(t + dt / 2, dt, forces), 0.0
        if len(self._known) < 2 or self._speed == 0:
            return 0.0
        later, (before, last) = size / self._speed, self._known
        way = (self._next.t - last.t) / (last.t - before.t)
        for title, force in forces.items():
            begun = t if self._settled(title) else self._begun.get(title, -inf)
            f0, f1 = (step.of.get(title, np.zeros(4)) for step in self._known)
            told = all(f[3] == 0 or s.dt <= LONGER * dt for f, s in ((f0, before), (f1, last)))
            if told and t <= begun + later:
                off += float(np.abs(force - f1 - (f1 - f0) * way).max())
        return later * dt / 12 * off / (2 * self._mass)

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._known, self._fastest = (*self._known[-1:], self._next), self._speed
        for title, force in self._next.of.items():
            closed = force[3] > 0
            if closed and self._settled(title):
                self._begun[title] = self._next.t
            self._open[title] = 0 if closed else self._open.get(title, SETTLED) + 1

    def _settled(self, title: str) -> bool:
        return self._open.get(title, 0) > SETTLED

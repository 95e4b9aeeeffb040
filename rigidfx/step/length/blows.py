"""The error of an impulse, as the force of a contact changes within a step.

The motion of a probe hardly shows this error at first: an impulse that is too large causes a small
error during the contact, and a growing one afterwards. A step takes the force at its middle for the
mean force, so the error of the impulse is

    Δt³/24 F'' ≈ Δt/24 |F - F*| ,

with F* the force that a line through the two steps before gives. Divided by the mass of the
lightest connected part that touches, this is an error of velocity, and after the time U/V an error
of displacement, with U the largest displacement and V the largest speed so far, or half of the
contact's impulse over that mass where that is more: a body may be struck at rest, and far from the
probes. It counts for this time after the closing of a contact that was open for some steps.
Contacts that rest or rattle send nothing off, and do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, sqrt
from typing import ClassVar, NamedTuple

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Contact, Touch
from rigidfx.scene.points import met, parts_of_nodes
from rigidfx.scene.scene import Scene

LONGER = 4.0  # times a step: the force in one so long tells nothing of that at its ends, but is
# next to nothing where it gives less than this step: a step that ends at a touch may press a little
SETTLED = 4  # steps that a contact has been open before it closes with a blow


class Blow(NamedTuple):
    """When a contact closed last after it had been open [s], and its impulse since then [N s]."""

    began: float
    impulse: float


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

    remembered: ClassVar[Remembered] = same("_known", "_open", "_last", "_fastest")

    def __init__(self, scene: Scene) -> None:
        """Nothing touches. Collective."""
        contacts = scene.named(Contact)
        self.any = bool(contacts)
        self._mass = _masses(scene, contacts) if contacts else {}
        self._known: tuple[Forces, ...] = ()  # of the last two steps
        self._next, self._speed = Forces(0.0, 0.0, {}), 0.0
        self._open: dict[str, int] = {}  # steps that each contact has been open
        self._last: dict[str, Blow] = {}  # of each contact
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
        if len(self._known) < 2:
            return 0.0
        before, last = self._known
        way = (self._next.t - last.t) / (last.t - before.t)
        for title, force in forces.items():
            blow, mass = self._add(title, force), self._mass[title]
            fastest = max(self._speed, blow.impulse / (2 * mass))
            if fastest == 0:
                continue
            f0, f1 = (step.of.get(title, np.zeros(4)) for step in self._known)
            given = force[3] * dt
            told = all(
                step.dt <= LONGER * dt or f[3] * step.dt <= given
                for f, step in ((f0, before), (f1, last))
            )
            if told and t <= blow.began + size / fastest:
                off += float(np.abs(force - f1 - (f1 - f0) * way).max()) / (2 * mass * fastest)
        return size * dt / 12 * off

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._known, self._fastest = (*self._known[-1:], self._next), self._speed
        for title, force in self._next.of.items():
            # A step that ends at a touch may press by rounding, on some ranks and not on others.
            least = sqrt(np.finfo(np.float64).eps) * self._mass[title] * self._fastest
            closed = force[3] * self._next.dt > least
            if closed:
                self._last[title] = self._add(title, force)
            self._open[title] = 0 if closed else self._open.get(title, SETTLED) + 1

    def _add(self, title: str, force: Array) -> Blow:
        """The blow of a contact with what the step that was looked at last adds."""
        t, dt, _ = self._next
        settled = self._open.get(title, 0) > SETTLED
        begun = Blow(t + dt / 2, 0.0)
        last = begun if settled else self._last.get(title, Blow(-inf, 0.0))
        return Blow(last.began, last.impulse + dt * float(np.linalg.norm(force[:3])))


def _masses(scene: Scene, contacts: Sequence[Contact]) -> dict[str, float]:
    """Mass of the lightest part that each contact may touch, by titles [kg]. Collective."""
    of_node, n, found = parts_of_nodes(scene), scene.owned_nodes, {}
    count = scene.parts.count
    whole = scene.sum(np.bincount(of_node[:n], scene.nodal_mass[:n], count))
    for contact in contacts:
        found[contact.title] = float(np.asarray(whole)[met(scene, contact)].min())
    return found

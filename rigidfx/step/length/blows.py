"""Error of a step as the force of a contact changes in it: an impulse.

The motion of a probe tells little of a blow: a body that was struck a little too hard errs by next
to nothing while it is struck, and by more and more as it flies. A step takes the force at its
middle for the mean, so that its impulse is off by Δt³/24 F'', the second derivative by the distance
of the force from the line through the two steps before. Over the mass that is a velocity; and a
motion of the size U and the speed V needs a time of U/V to come where that shows. So long a
blow is taken to last, too, from when a contact closes that has been open for some steps: where
something rests or rattles nothing is sent off, and steps stay what they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Contact, Touch
from rigidfx.scene.scene import Scene

__all__ = ["Blows"]

Array = npt.NDArray[np.float64]

LONGER = 4.0  # times a step: forces in one so long tell nothing of those at its ends
SETTLED = 4  # steps that a contact has been open before it closes with a blow


@dataclass(frozen=True)
class Forces:
    """Those of contacts in a step.

    Attributes:
        t: Its middle [s].
        dt: Its length [s].
        forces: Force of each contact by titles, and the sum of the sizes of its nodal forces, shape
            (4,) [N].
    """

    t: float
    dt: float
    forces: Mapping[str, Array]

    def of(self, title: str, longest: float) -> Array | None:
        """Those of a contact; None if the step was too long for them to tell of its middle."""
        force = self.forces.get(title, np.zeros(4))
        return None if force[3] > 0 and self.dt > longest else force


class Blows:
    """Follows the forces of contacts.

    Attributes:
        any: Whether there are contacts.
    """

    remembered: ClassVar[Remembered] = same("_known", "_open", "_begun")

    def __init__(self, scene: Scene) -> None:
        """Nothing touches. Collective.

        Args:
            scene: The problem.
        """
        self.any = bool(scene.named(Contact))
        self._mass = float(scene.sum(scene.nodal_mass[: scene.owned_nodes].sum()))
        self._known: list[Forces] = []  # of the last two steps
        self._next = Forces(0.0, 0.0, {})
        self._open: dict[str, int] = {}  # steps that each contact has been open
        self._begun: dict[str, float] = {}  # when the last blow of each began [s]

    def look(self, touches: Mapping[str, Touch], t: float, dt: float, later: float) -> float:
        """By how much a step that has been solved errs once it shows [m].

        Args:
            touches: Effects of contacts in it.
            t: Time at its start [s].
            dt: Its length [s].
            later: Time after which an error of velocity shows [s].
        """
        forces = {title: np.array([*a.force, a.pressing]) for title, a in touches.items()}
        self._next, off = Forces(t + dt / 2, dt, forces), 0.0
        if len(self._known) < 2:
            return 0.0
        before, last = self._known
        way = (self._next.t - last.t) / (last.t - before.t)
        for title, force in forces.items():
            begun = t if self._open.get(title, 0) > SETTLED else self._begun.get(title, -inf)
            f0, f1 = (step.of(title, LONGER * dt) for step in (before, last))
            if t <= begun + later and f0 is not None and f1 is not None:
                off += float(np.abs(force - f1 - (f1 - f0) * way).max())
        return later * dt / 24 * off / self._mass

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._known = [*self._known[-1:], self._next]
        for title, force in self._next.forces.items():
            closed = force[3] > 0
            if closed and self._open.get(title, 0) > SETTLED:
                self._begun[title] = self._next.t
            self._open[title] = 0 if closed else self._open.get(title, SETTLED) + 1

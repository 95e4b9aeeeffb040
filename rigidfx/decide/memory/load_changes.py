"""Changes of loads and supports, which release bodies with `wake="all"` (3.3).

A change is a declared breakpoint (a jump, a kink, the end of a time window), at which a step ends;
or a load, or the velocity of a support, that differs from its value at the last freeze by more than
a given fraction of its largest value so far. Loads and supports are functions of time, so a change
is known before the step in which it happens. The `signal` of an effect is the value that counts.
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import by_name, together
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Effect, Support, Windowed
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

__all__ = ["LoadChanges"]


REST = 1e-3  # of its largest value so far, by which a load at rest may change


class LoadChanges:
    """Watches loads and supports of a scene.

    Attributes:
        reference: Signal of each load when the present bodies were frozen.
        largest: Largest norm of each so far.
        resting_since: Time since which none has changed by more than a thousandth of that [s].
    """

    remembered: ClassVar[Remembered] = same("reference", "largest", "resting_since", "_resting")

    def __init__(self, scene: Scene, fraction: float, timeline: Timeline) -> None:
        """Collect breakpoints and loads. Collective.

        Args:
            scene: The problem.
            fraction: Change of a load that counts, relative to its largest value so far.
            timeline: Where steps end.
        """
        self._comm, self._fraction, self._timeline = scene.comm, fraction, timeline
        windowed = [effect for effect in scene.named(Windowed) if effect.is_load]
        self._breakpoints = np.unique([t for effect in windowed for t in effect.breakpoints])
        self._supports = np.unique([t for effect in scene.named(Support) for t in effect.ends])
        self._loads = [load for load in windowed if type(load).signal is not Effect.signal]
        self._idle: list[Array] | None = None  # what signals are while no load acts
        self.reference = self._signals(0.0)
        self.largest = [float(np.linalg.norm(q)) for q in self.reference]
        self.resting_since, self._resting = 0.0, self.reference

    def declared(self, t: float) -> bool:
        """Whether a load or a support has a breakpoint at t [s]."""
        return any(self._timeline.same(t, b) for b in self._breakpoints)

    def support_changes(self, t: float) -> bool:
        """Whether a support begins or ends at t [s]."""
        return any(self._timeline.same(t, end) for end in self._supports)

    def remember(self, t: float) -> None:
        """Record the loads at t [s] as those of the present bodies. Collective."""
        self.reference = self._signals(t)

    def ahead(self, t: float) -> str:
        """The first load that at t [s] differs too much, "" if none does. Collective."""
        if not np.isfinite(self._fraction):
            return ""
        for load, q, reference, size in zip(
            self._loads, self._signals(t), self.reference, self.largest, strict=True
        ):
            if np.linalg.norm(q - reference) > self._fraction * size:
                return load.owner
        return ""

    def observe(self, t: float) -> Array:
        """Components of all loads at t [s], each in its own unit. Collective."""
        values = self._signals(t)
        sizes = [float(np.linalg.norm(q)) for q in values]
        self.largest = [max(pair) for pair in zip(sizes, self.largest, strict=True)]
        three = zip(values, self._resting, self.largest, strict=True)
        if any(np.linalg.norm(q - rest) > REST * size for q, rest, size in three):
            self.resting_since, self._resting = t, values
        return np.concatenate([np.empty(0), *values])

    def _signals(self, t: float) -> list[Array]:
        if any(load.acts(t) for load in self._loads):
            return self._asked(t)
        if self._idle is None:
            self._idle = self._asked(t)
        return self._idle

    def _asked(self, t: float) -> list[Array]:
        """Signals of the loads as they themselves give them. Collective."""
        dt = self._timeline.dt

        def signals() -> list[Array]:
            return [
                np.array(by_name(load.owner, t, partial(load.signal, t, dt)))
                for load in self._loads
            ]

        values = together(self._comm, "A load", signals)
        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        return list(self._comm.bcast(values))

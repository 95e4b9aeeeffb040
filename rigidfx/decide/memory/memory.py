"""All that a policy remembers: windows of observation, changes of loads and contacts, waiting.

A change of a load (`wake="all"`, 3.3) is a declared breakpoint (a jump, a kink, the end of a time
window), at which a step ends; or a load, or the velocity of a support, that differs from its value
at the last freeze by more than a given fraction of its largest value so far. Loads and supports are
functions of time, so a change is known before the step in which it happens. The `signal` of an
effect is the value that counts.

The force of a contact is known after a step has been solved. If it differs from its value at the
last freeze in the same way, bodies are released and the step is solved again, so that the struck
part is flexible in the step of the impact. A first touch is such a change; rattling with smaller
forces is none. If the forces of a contact add up to zero, as those of a surface against itself, the
sum of their magnitudes counts.

A changing load, or a condition of the user's, may release cells that have just become rigid. A
window later they would freeze again, and be released again. This saves no time, and each switch
loses the phase of a vibration. A release is *hasty* if a cell was observed for longer than it was
rigid. After n hasty releases in a row a cell has to qualify in γⁿ⁻¹ windows in a row before it may
become rigid again: in one window after the first hasty release, in γ windows after the second. In a
time T there are then about log T/log γ switches instead of T/T_red. Any other release resets the
count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import by_name, together
from rigidfx.base.instants import longer
from rigidfx.base.remembered import ON_CELLS, PART, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.decide.memory.signals import Signals
from rigidfx.effects import Effect, Support, Touch, Windowed
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

NOTHING = np.zeros(4)
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


class BackOff:
    """Keeps, for each owned cell, how long it has qualified and how hastily it was released.

    Attributes:
        hasty: Number of hasty releases in a row.
        windows: Number of windows in a row in which a cell has qualified.
        observed: Their length [s].
        rigid_since: When a cell became rigid [s]; NaN while it is flexible.
    """

    remembered: ClassVar[Remembered] = dict.fromkeys(
        ("windows", "observed", "rigid_since", "hasty"), ON_CELLS
    )

    def __init__(self, cells: int, growth: float) -> None:
        """Nothing has been observed.

        Args:
            cells: Number of owned cells.
            growth: γ ≥ 1; 1 lets cells never wait.
        """
        self._growth = growth
        self.hasty = np.zeros(cells, dtype=np.int64)
        self.windows = np.zeros(cells, dtype=np.int64)
        self.observed = np.zeros(cells)
        self.rigid_since = np.full(cells, np.nan)

    @property
    def rigid(self) -> Bools:
        """Which cells were rigid at the last `switched`."""
        return ~np.isnan(self.rigid_since)

    def needed(self) -> Array:
        """Windows in a row in which each cell has to qualify."""
        return self._growth ** np.maximum(self.hasty - 1, 0)

    def restart(self) -> None:
        """Something has changed: forget the observations of flexible cells."""
        flexible = np.isnan(self.rigid_since)
        self.windows[flexible], self.observed[flexible] = 0, 0.0

    def lasting(self, able: Bools) -> Bools:
        """Of the cells that have qualified in a window, those that have waited long enough.

        Args:
            able: Cells that have qualified in the window that ends now.
        """
        return able & ~longer(self.needed(), self.windows + 1)

    def window_ended(self, able: Bools, length: float) -> None:
        """Record the end of a window.

        Args:
            able: Cells that have qualified.
            length: Length of the window [s].
        """
        self.windows[able] += 1
        self.observed[able] += length
        failed = ~able & np.isnan(self.rigid_since)
        self.windows[failed], self.observed[failed] = 0, 0.0

    def switched(self, rigid: Bools, t: float, counts: bool) -> bool:
        """Record which cells are rigid after an event.

        Args:
            rigid: Cells in bodies.
            t: Time [s].
            counts: Whether a hasty release counts; one that was planned does not.

        Returns:
            Whether a cell has to wait longer from now on.
        """
        was = self.rigid
        released, frozen = was & ~rigid, rigid & ~was
        soon = released & longer(self.observed, t - self.rigid_since)
        if counts:
            self.hasty[soon] += 1
            self.hasty[released & ~soon] = 0
        self.rigid_since[frozen], self.rigid_since[released] = t, np.nan
        self.windows[released], self.observed[released] = 0, 0.0
        return bool(counts and self._growth > 1 and (self.hasty[soon] > 1).any())


class ContactChanges:
    """Watches the forces of contacts."""

    remembered: ClassVar[Remembered] = same("_last", "_reference", "_largest")

    def __init__(self, fraction: float) -> None:
        """Begin without any.

        Args:
            fraction: Change that counts, relative to the largest force of that contact so far.
        """
        self._fraction = fraction
        self._last: dict[str, Array] = {}
        self._reference: dict[str, Array] = {}
        self._largest: dict[str, float] = {}

    @property
    def watched(self) -> bool:
        """Whether any change counts."""
        return bool(np.isfinite(self._fraction))

    def changed(self, touches: Mapping[str, Touch]) -> list[str]:
        """Titles of contacts that differ too much in a step that has been solved.

        Args:
            touches: Effects of contacts in it.
        """
        changes = {k: _of(touch) - self._reference.get(k, NOTHING) for k, touch in touches.items()}
        least = {k: self._fraction * self._largest.get(k, 0.0) for k in changes}
        return [k for k, change in changes.items() if _size(change) > least[k]]

    def follow(self, touches: Mapping[str, Touch]) -> None:
        """Record a step that was accepted."""
        self._last = {title: _of(touch) for title, touch in touches.items()}
        for title, forces in self._last.items():
            self._largest[title] = max(_size(forces), self._largest.get(title, 0.0))

    def remember(self) -> None:
        """Record the last forces as those of the present bodies."""
        self._reference = dict(self._last)


def _of(touch: Touch) -> Array:
    """The force of a contact, and the sum of the sizes of its nodal forces, shape (4,) [N]."""
    return np.array([*touch.force, touch.pressing])


def _size(forces: Array) -> float:
    """Size of either, or of its change, whichever is larger [N]."""
    return max(float(np.linalg.norm(forces[:3])), abs(float(forces[3])))


class Window:
    """Largest strain rate of each cell since the window began.

    Attributes:
        start: Time at which it began [s].
        worst: Per owned cell [1/s].
        steps: Number of steps observed.
        whole: Whether a cell has been flexible in all of them.
        over: Whether it has its length.
    """

    remembered: ClassVar[Remembered] = same("start", "steps", "over") | {
        "worst": ON_CELLS,
        "whole": ON_CELLS,
    }

    def __init__(self, cells: int, start: float) -> None:
        """A window that begins.

        Args:
            cells: Number of owned cells.
            start: Time [s].
        """
        self.start, self.worst, self.steps = start, np.zeros(cells), 0
        self.whole = np.ones(cells, dtype=bool)
        self.over = False

    def add(self, cells: Indices, rates: Array) -> None:
        """Observe a step.

        Args:
            cells: Flexible owned cells.
            rates: Their strain rates [1/s].
        """
        self.worst[cells] = np.maximum(self.worst[cells], rates)
        self.steps += 1


@dataclass
class Memory:
    """All that a policy remembers.

    Attributes:
        window: The window of observation.
        signals: The motion and the loads since the last change.
        back_off: How long cells have to wait.
        loads: The loads of the present bodies, and the largest so far.
        contacts: The same of contacts.
        next_number: First number that no body has had.
        said: Kinds of warnings that were given.
        largest: Largest strain rate of any cell so far, if tolerances are relative to it [1/s].
    """

    remembered: ClassVar[Remembered] = same("next_number", "said", "largest") | dict.fromkeys(
        ("window", "signals", "back_off", "loads", "contacts"), PART
    )

    window: Window
    signals: Signals
    back_off: BackOff
    loads: LoadChanges
    contacts: ContactChanges
    next_number: int
    said: set[str] = field(default_factory=set)
    largest: float = 0.0

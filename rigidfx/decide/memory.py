"""All that a policy remembers: windows of observation, changes of loads and contacts, waiting.

A change of a load (`wake="all"`, 3.3) is a declared breakpoint (a jump, a kink, the end of a time
window), at which a step ends; or a load, or the velocity of a support, that differs from its value
at the last freeze by more than a given fraction of its largest value so far. It is known before
the step in which it happens. The `signal` of an effect is the value that counts.

The force of a contact is known after a step has been solved. If it differs from its value at the
last freeze in the same way, bodies are released and the step is solved again. A first touch is such
a change; rattling with smaller forces is none. If forces add up to zero, as those of a surface
against itself, the sum of their magnitudes counts.

A changing load, or a condition of the user's, may release cells that have just become rigid. By
rule 5 of docs/theory/waking.md there are then about log T/log γ switches in a time T instead of
T/T_red. A release that is not hasty resets the count.

A window has to exceed the period of the lowest excited mode and that of the loads (3.1): that of
the lowest peak in spectra of the loads, and of distances between a few nodes far from each other.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import numpy as np
from scipy.spatial.distance import pdist

from rigidfx.base.errors import by_name, together
from rigidfx.base.instants import longer
from rigidfx.base.remembered import ON_CELLS, PART, Remembered, same
from rigidfx.base.types import Array, Bools, Indices
from rigidfx.effects import Effect, Support, Touch, Windowed
from rigidfx.scene.points import far_apart
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.state import State

NOTHING = np.zeros(4)
HELD = "a support begins or ends, or a motor begins to lead"
REST = 1e-3  # of its largest value so far, by which a load at rest may change
TELLTALES = 8  # nodes whose distances are recorded
CYCLES = 3.0  # cycles of a signal in a record before its period is believed
EXCITED = 0.05  # amplitude relative to the largest swing at which a mode counts as excited
SAMPLES = 2048  # longest record; older samples are forgotten
STILL = 1e-10  # relative amplitude below which nothing moves


class LoadChanges:
    """Watches loads and supports of a scene.

    Attributes:
        reference: Signal of each load when the present bodies were frozen.
        largest: Largest norm of each so far.
        resting_since: Time since which none has changed by more than a thousandth of that [s].
    """

    remembered: ClassVar[Remembered] = same("reference", "largest", "resting_since", "_resting")

    def __init__(self, scene: Scene, timeline: Timeline, fraction: float, every: bool) -> None:
        """Collect breakpoints, of loads if `every` one counts, and loads. Collective.

        The change of a load that counts is a fraction of its largest value so far.
        """
        self._comm, self._timeline, self._fraction = scene.comm, timeline, fraction
        windowed = [effect for effect in scene.named(Windowed) if effect.is_load]
        loads, supports = [e.breakpoints for e in windowed], [e.ends for e in scene.named(Support)]
        supports += [(motor.since,) for motor in windowed if motor.prescribes]  # an impact, too
        self._breaks = sorted({t for own in (loads if every else supports) for t in own})
        self._reason = "a load or a support changes" if every else HELD
        self._loads = [load for load in windowed if type(load).signal is not Effect.signal]
        self._idle: list[Array] | None = None  # signals while no load acts
        self.reference = self._signals(0.0)
        self.largest = [float(np.linalg.norm(q)) for q in self.reference]
        self.resting_since, self._resting = 0.0, self.reference

    def declared(self, t: float) -> str:
        """The change that is declared for t [s], in words, "" if none is."""
        found = any(self._timeline.same(t, own) for own in self._breaks)
        return self._reason if found else ""

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
        """Signals of the loads at t [s]. Collective."""
        dt, acting = self._timeline.dt, any(load.acts(t) for load in self._loads)
        if not acting and self._idle is not None:
            return self._idle

        def signals() -> list[Array]:
            return [np.array(by_name(e.owner, t, partial(e.signal, t, dt))) for e in self._loads]

        values = together(self._comm, "A load", signals)
        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        values = list(self._comm.bcast(values))
        if not acting:
            self._idle = values
        return values


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
        """Nothing has been observed; growth is γ ≥ 1, where 1 lets cells never wait."""
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
        """Of cells that have qualified in a window that ends, those that have waited enough."""
        return able & ~longer(self.needed(), self.windows + 1)

    def window_ended(self, able: Bools, length: float) -> None:
        """Record the end of a window of some length [s], and the cells that have qualified."""
        self.windows[able] += 1
        self.observed[able] += length
        failed = ~able & np.isnan(self.rigid_since)
        self.windows[failed], self.observed[failed] = 0, 0.0

    def switched(self, rigid: Bools, t: float, counts: bool) -> bool:
        """Record which cells are rigid after an event at t; whether one has to wait longer now.

        A release that was planned does not count as hasty.
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
        """Begin without any; a fraction of the largest force of a contact so far counts."""
        self._fraction = fraction
        self._last: dict[str, Array] = {}
        self._reference: dict[str, Array] = {}
        self._largest: dict[str, float] = {}

    @property
    def watched(self) -> bool:
        """Whether any change counts."""
        return bool(np.isfinite(self._fraction))

    def changed(self, touches: Mapping[str, Touch]) -> list[str]:
        """Titles of contacts that differ too much in a step that has been solved."""
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
        """A window of some owned cells that begins at a time [s]."""
        self.start, self.worst, self.steps = start, np.zeros(cells), 0
        self.whole = np.ones(cells, dtype=bool)
        self.over = False

    def add(self, cells: Indices, rates: Array) -> None:
        """Observe a step: strain rates of flexible owned cells [1/s]."""
        self.worst[cells] = np.maximum(self.worst[cells], rates)
        self.steps += 1


class Signals:
    """Signals of the motion and of the loads since the last change."""

    remembered: ClassVar[Remembered] = same(
        "_times", "_distances", "_loads", "_longest", "_looked_at", "_added"
    )

    def __init__(self, scene: Scene) -> None:
        """Choose the telltale nodes: far from each other, the same on any ranks. Collective."""
        self._comm = scene.comm
        self._nodes, places = far_apart(scene, TELLTALES)
        self._order = np.argsort(np.concatenate(self._comm.allgather(places)))
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._times: deque[float] = deque(maxlen=SAMPLES)
        self._distances: deque[Array] = deque(maxlen=SAMPLES)
        self._loads: deque[Array] = deque(maxlen=SAMPLES)
        self._longest, self._looked_at, self._added = float("nan"), 0, 0

    def add(self, state: State, loads: Array) -> None:
        """Record a state. Collective."""
        x = state.positions(self._nodes)
        if self._comm.size > 1:
            x = np.concatenate(self._comm.allgather(x))
        self._times.append(state.t)
        self._distances.append(pdist(x[self._order]))
        self._loads.append(loads)
        self._added += 1

    def rest_since(self, t: float) -> None:
        """Record the time from which on loads have rested [s].

        Once loads have rested for half of the record, its older half is forgotten. A load that has
        risen and stays is no oscillation, but looks like the beginning of a slow one.
        """
        if not self._times or not self._times[0] < t < (self._times[0] + self._times[-1]) / 2:
            return
        for _ in range(sum(other < t for other in self._times)):
            self._times.popleft()
            self._distances.popleft()
            self._loads.popleft()
        self._longest, self._looked_at, self._added = float("nan"), 0, len(self._times)

    def period(self) -> float:
        """Longest period seen [s]; 0 where nothing oscillates, NaN while that cannot be told.

        A spectrum is taken no more often than each time the record has grown by an eighth.
        """
        if self._added - self._looked_at >= max(1, len(self._times) // 8):
            self._looked_at = self._added
            t = np.asarray(self._times)
            distances, loads = np.asarray(self._distances), np.asarray(self._loads)
            seen = np.max([longest_period(t, distances), longest_period(t, loads)])
            self._longest = float(np.fmax(self._longest, seen))
            if len(t) == SAMPLES and np.isnan(self._longest):
                self._longest = float(t[-1] - t[0])  # no record can tell more
        return self._longest


def longest_period(t: Array, signals: Array) -> float:
    """The longest period at which signals of one kind oscillate, shape (n, signals) [s].

    Zero if nothing oscillates, NaN if the record is too short to tell.
    """
    if signals.shape[1:] == (0,):
        return 0.0
    if len(t) < 8:
        return float("nan")
    even = np.linspace(t[0], t[-1], len(t))
    values = np.stack([np.interp(even, t, s) for s in signals.T], axis=1)
    rest = STILL * float(np.abs(values).max())
    values = without_trend(values)
    swings = np.ptp(values, axis=0)
    moving = swings > max(rest, EXCITED * float(swings.max()))
    if not moving.any():
        return 0.0
    # SciPy has a periodogram, and takes 0.3 s to import.
    window = np.sin(np.pi * np.arange(len(even)) / len(even)) ** 2  # von Hann's
    spectrum = np.fft.rfft(values[:, moving] * window[:, None], 4 * len(even), axis=0)
    frequency = np.fft.rfftfreq(4 * len(even), even[1] - even[0])
    amplitude = 2 / window.sum() * np.abs(spectrum).max(axis=1)
    amplitude[[0, -1]] /= np.sqrt(2)  # which the other side does not have
    told = frequency * (t[-1] - t[0]) >= CYCLES
    a = np.where(told & (amplitude >= EXCITED * swings.max() / 2), amplitude, 0.0)
    peaks = 1 + np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:]))
    # What is slower than a few cycles in the record may be a trend, unless it outweighs the rest.
    slow = amplitude[~told].max(initial=0.0)
    if slow > max(EXCITED * swings.max() / 2, amplitude[peaks].max(initial=0.0)):
        return float("nan")
    if not peaks.size:
        return 0.0
    return float(1 / frequency[peaks[0]])


def without_trend(values: Array) -> Array:
    """Values less the straight line through them, shape (n, signals).

    As `scipy.signal.detrend`, without its general least squares, which took a tenth of a run of
    1722 unknowns.
    """
    i = np.arange(len(values)) - (len(values) - 1) / 2
    return np.asarray(values - values.mean(axis=0) - np.outer(i, i @ values / (i @ i)))


@dataclass
class Memory:
    """All that a policy remembers."""

    remembered: ClassVar[Remembered] = same("next_number", "said", "largest") | dict.fromkeys(
        ("window", "signals", "back_off", "loads", "contacts"), PART
    )

    window: Window  # the window of observation
    signals: Signals  # the motion and the loads since the last change
    back_off: BackOff  # how long cells have to wait
    loads: LoadChanges  # the loads of the present bodies, and the largest so far
    contacts: ContactChanges  # the same of contacts
    next_number: int  # first number that no body has had
    said: set[str] = field(default_factory=set)  # kinds of warnings that were given
    # Largest strain rate of any cell so far, if tolerances are relative to it [1/s]
    largest: float = 0.0

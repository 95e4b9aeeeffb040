"""The longest period in the motion and in the loads, for the length of a window.

T_red has to exceed the period of the lowest excited mode and that of the loads (3.1). Both periods
are found in signals without rigid motion: distances between a few nodes far from each other, and
the loads. The longest period is that of the lowest peak in their spectra.
"""

from __future__ import annotations

from collections import deque
from typing import ClassVar

import numpy as np
from scipy.spatial.distance import pdist

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.scene.points import far_apart
from rigidfx.scene.scene import Scene
from rigidfx.state import State

TELLTALES = 8  # nodes whose distances are recorded
CYCLES = 3.0  # cycles of a signal in a record before its period is believed
EXCITED = 0.05  # amplitude relative to the largest swing at which a mode counts as excited
SAMPLES = 2048  # longest record; older samples are forgotten
REST = 1e-10  # relative amplitude below which nothing moves


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
    """The longest period at which signals of one kind oscillate.

    Args:
        t: Times [s], increasing, shape (n,).
        signals: Shape (n, signals).

    Returns:
        Period [s]; 0 if nothing oscillates, NaN if the record is too short to tell.
    """
    if signals.shape[1:] == (0,):
        return 0.0
    if len(t) < 8:
        return float("nan")
    even = np.linspace(t[0], t[-1], len(t))
    values = np.stack([np.interp(even, t, s) for s in signals.T], axis=1)
    rest = REST * float(np.abs(values).max())
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

"""Instants at which steps have to end, and steps of equal length up to the next one."""

from __future__ import annotations

from math import ceil, nan
from typing import ClassVar

import numpy as np

from rigidfx.base.instants import longer
from rigidfx.base.remembered import Remembered, same
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

__all__ = ["Breakpoints"]

STRETCH = 0.1  # of Δt, by which a step may be longer to end at a breakpoint


class Breakpoints:
    """The breakpoints of a run: those of a scene, and events that are found on the way."""

    remembered: ClassVar[Remembered] = same("_event", "_stop", "_step", "_for")

    def __init__(self, scene: Scene, timeline: Timeline) -> None:
        """Add those of a scene to a timeline, but for kinks that may be stepped over."""
        self._timeline, bends = timeline, scene.bends
        self._bends = np.array(list(bends)), np.array(list(bends.values()))
        self._breaks = [t for t in scene.breakpoints if t > 0 and t not in bends]
        timeline.stop_at(self._breaks)
        self._event = self._stop = self._step = self._for = nan

    def expect(self, event: float) -> None:
        """Take a time [s] for a breakpoint."""
        self._event = event

    def meets(self, t: float) -> bool:
        """Whether a breakpoint is at a time [s]."""
        return any(self._timeline.same(t, b) for b in (*self._breaks, self._event))

    def forget(self) -> None:
        """Divide what is left anew."""
        self._stop = nan

    def end(self, t: float, dt: float, longest: float, tol: float) -> float:
        """End of the step that begins at a time, if nothing else happens [s].

        Args:
            t: The time [s].
            dt: Δt that is wanted [s].
            longest: Δt that is never exceeded [s].
            tol: Error of a load's mean that does not matter, over its largest value.
        """
        stop = self._stop_after(t, dt, tol)
        if stop != self._stop or dt != self._for:
            self._stop, self._for = stop, dt
            steps = max(1, ceil((stop - t) / dt - STRETCH))
            if longer((stop - t) / steps, longest):
                steps += 1
            self._step = (stop - t) / steps
        return stop if round((stop - t) / self._step) <= 1 else t + self._step

    def _stop_after(self, t: float, dt: float, tol: float) -> float:
        stop = self._timeline.stop_after(t)
        times, changes = self._bends
        # Over a kink inside, the load at the middle is wrong by an eighth of that, in the mean.
        strong = times[changes * dt / 8 > tol]
        k = int(np.searchsorted(strong, t + self._timeline.resolution, side="right"))
        return min(stop, float(strong[k])) if k < strong.size else stop

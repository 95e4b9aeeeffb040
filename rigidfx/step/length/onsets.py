"""Where loads jump, bend or swing within a step, at no breakpoint: found before the step is made.

A step takes loads at its middle. Where one is smooth, its mean over the step differs from that by
h²/24 q'', of which the motion's own jerk tells. A load that sets in after the middle loses up to
half of q h, and nothing in the motion tells. So loads that are functions of a user's are asked at
five times of a step. If their mean by Simpson's rule is off the middle by more than the tolerance's
part of what they have changed by so far, the interval with the largest second
difference is halved again and again: that falls with the square of its width where the load is
smooth, with its width over a kink, and not over a jump. The step ends where that has been found;
after a jump steps begin anew, unless it is a small one.

A load that swings to and fro in some three steps is smooth, and the motion, which is told the
middles, knows nothing of it. So where a load turns within the step and its mean is off by more than
a twentieth, the step is halved until it is not; by more than the tolerance's part where the load
sets in, as a middle that lies before that tells nothing. A sine of two steps may have a mean of
nothing in each, as its middles are. So what a load is at the five times is compared with the line
through
the middles of this step and the one before, too: the curvature that explains it would put the mean
off by h²/24 of it, and where that is more than a tenth the step is halved as well. Windows, kinks
of a `Table` and `breakpoints` are known without all that.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import together
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.effects import Support
from rigidfx.scene.scene import Scene
from rigidfx.step.length.given import given_loads
from rigidfx.step.length.narrowing import Onset, narrowed

__all__ = ["Onsets"]

Array = npt.NDArray[np.float64]

WITHIN = 1e-6  # of a step: so far inside its ends it is asked, as windows may begin or end there
PLACES = np.array([WITHIN, 0.25, 0.5, 0.75, 1 - WITHIN])
SIMPSON = np.array([1, 4, 2, 4, 1]) / 12
OTHERS = [0, 1, 3, 4]  # than the middle
SEVERAL = 4  # in one step, of which the first counts
SWINGS = 0.05  # of what a load changes by: its mean is off by more where a step is half a swing
SETS_IN = 2.0  # times what a load has changed by, that a step has it change by where it sets in
UNTOLD = 0.1  # likewise, by what the middles of steps do not tell
SHORTER = 6  # halvings of a step for that
CLOSE = 1e-3  # of a step after its start: that is where it had to begin
SHARP = 1e-4  # of a step: a path is looked at as if it were so long, not to see beyond its end
SMALL = 0.1  # of what a load changes by: a jump that steps need not begin anew for


class Onsets:
    """Looks for them among those loads of a scene that are functions of a user's."""

    remembered: ClassVar[Remembered] = same("_middles") | {"_loads": PART}

    def __init__(self, scene: Scene) -> None:
        """Collect these loads. Collective.

        Args:
            scene: The problem.
        """
        self._comm, self._loads = scene.comm, given_loads(scene)
        # Of each load the middle of the last step that was looked at, and its value there.
        self._middles: list[tuple[float, Array] | None] = [None] * len(self._loads)

    def forget(self) -> None:
        """Loads may have jumped: lines through middles tell nothing."""
        self._middles = [None] * len(self._loads)

    def within(self, t: float, end: float, tol: float) -> Onset | None:
        """The first in a step that matters; None if there is none. Collective.

        Args:
            t: Start of the step [s].
            end: Its end [s].
            tol: Error of a load in the mean that does not matter, over the change of its components
                so far.

        Raises:
            SceneError: On every rank, if a load's function fails on any, or gives something else
                when asked again.
        """
        if not self._loads:
            return None

        def first() -> Onset | None:
            found = None
            for k in range(len(self._loads)):
                found = self._first_of(k, t, end if found is None else found.t, tol) or found
            return found

        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        found = self._comm.bcast(together(self._comm, "A load", first))
        if found is not None:
            self.forget()
        return found

    def _first_of(self, k: int, t: float, end: float, tol: float) -> Onset | None:
        """The first of one load."""
        given, found, h = self._loads[k], None, end - t
        changed, turns = float(given.changed.max()), SWINGS
        led = isinstance(given.load, Support)
        short = SHARP * h if led else h

        def q(time: float) -> Array:
            return given.at(time, h)

        def sharp(time: float) -> Array:
            return given.at(time, short)

        for _ in range(SEVERAL):
            times = t + PLACES * (end - t)
            values = [q(float(time)) for time in times]
            off, swing = self._off(k, times, values, turns)
            if given.changed.max() > SETS_IN * changed and tol < turns:
                turns = tol
                off, swing = self._off(k, times, values, turns)
            if led and (off > tol or swing > 1):
                values = [sharp(float(time)) for time in times]
                off, swing = self._off(k, times, values, turns)
            self._middles[k] = float(times[2]), values[2]
            if off <= tol and swing <= 1:
                return found
            one = narrowed(sharp, times, values) if off > tol else None
            if one is None:
                return self._calm(k, q, t, end, (swing, turns)) or found
            if not t + CLOSE * (end - t) < one.t < end:
                return found
            given.ask_again(one.t, short, sharp(one.t))
            jumps = one.by is not None and given.part(one.by) > SMALL
            found, end = Onset(one.t, jumps, led=led and one.by is not None), one.t
        return found

    def _calm(
        self,
        k: int,
        q: Callable[[float], Array],
        t: float,
        end: float,
        off: tuple[float, float],
    ) -> Onset | None:
        """The end of a step in which a smooth load does not swing to and fro; None if it does not.

        Args:
            k: Number of the load.
            q: The load.
            t: Start of the step [s].
            end: Its end [s].
            off: Its swing that the motion does not know, over the permitted one, and `turns` of
                `_off`.
        """
        whole, (swing, turns) = end, off
        for _ in range(SHORTER):
            if swing <= 1:
                break
            end = (t + end) / 2
            times = t + PLACES * (end - t)
            _, swing = self._off(k, times, [q(float(time)) for time in times], turns)
        return Onset(end, jumps=False) if end < whole else None

    def _off(self, k: int, times: Array, values: list[Array], turns: float) -> tuple[float, float]:
        """By how much the mean of a load is off its middle, over its change so far.

        Args:
            k: Number of the load.
            times: Five times of a step [s].
            values: Its value there.
            turns: Permitted error of its mean where it turns within the step, likewise.

        Returns:
            The same; and its swing that the motion does not know, over the permitted one.
        """
        given, before = self._loads[k], self._middles[k]
        every = given.known(values)
        if every is None:
            return 0.0, 0.0
        apart = np.einsum("k,kpi->pi", SIMPSON, every) - every[2]
        off, swing = given.part(apart), 0.0
        if off > turns:
            rising = np.diff(every, axis=0) > 0
            swing = given.part(apart * (rising.any(axis=0) & ~rising.all(axis=0))) / turns
        if before is not None and before[0] <= times[0] and before[1].shape == apart.shape:
            swing = max(swing, given.part(_untold(*before, times, every)) / UNTOLD)
        return off, swing


def _untold(t: float, q: Array, times: Array, every: Array) -> Array:
    """Error of a mean by the curvature that the line through two middles does not tell.

    Args:
        t: Middle of the step before [s].
        q: The load there, shape (nodes, components).
        times: Five times of the step [s].
        every: The load there, shape (5, nodes, components).
    """
    middle = times[2]
    at = times[OTHERS, None, None]
    after = at - middle
    slope = (every[2] - q) / (middle - t)
    bends = np.abs((every[OTHERS] - every[2] - slope * after) / ((at - t) * after))
    return np.asarray((times[4] - times[0]) ** 2 / 12 * bends.max(axis=0))

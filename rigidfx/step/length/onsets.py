"""Where loads jump, bend or swing within a step, at no breakpoint: found before the step is made.

A step takes loads at its middle. Where one is smooth, its mean over the step differs from that by
h²/24 q'', of which the motion's own jerk tells. What sets in after the middle is lost for good, up
to half of q h, and nothing in the motion tells. So loads that are functions of a user's are asked
at five times of a step. If their mean by Simpson's rule is off the middle by more than the
tolerance's part of what they have changed by so far, the interval with the largest second
difference is halved again and again: that falls with the square of its width where the load is
smooth, with its width over a kink, and not over a jump. The step ends where that has been found;
after a jump steps begin anew. Where nothing is found, a load turns within the step and its mean is
off by more than a twentieth, as that of one that swings to and fro in three steps, the step is
halved until it is not: the motion, which is told the middles, knows nothing of it. Windows, kinks
of a `Table` and `breakpoints` are known without all that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import by_name, together
from rigidfx.base.inputs import is_function
from rigidfx.effects import Effect, Table, Windowed
from rigidfx.scene.scene import Scene

__all__ = ["Onset", "Onsets", "narrowed"]

Array = npt.NDArray[np.float64]

WITHIN = 1e-6  # of a step: so far inside its ends it is asked, as windows may begin or end there
PLACES = np.array([WITHIN, 0.25, 0.5, 0.75, 1 - WITHIN])
SIMPSON = np.array([1, 4, 2, 4, 1]) / 12
HALVINGS = 14
SMOOTH = 1.5  # powers of an interval's width with which second differences fall: 2 are smooth ...
SHARP = 0.5  # ... 1 is a kink, and 0 a jump
SCATTER = 2.0  # of them, as a kink lies in the middle of an interval or at its border
SEVERAL = 4  # in one step, of which the first counts
SWINGS = 0.05  # of what a load changes by: its mean is off by more where a step is half a swing
SHORTER = 6  # halvings of a step for that
ROUNDING = 1e-12  # of a component's size, by which none has changed
LEAST = float(np.finfo(float).tiny / np.finfo(float).eps)  # numbers below have fewer digits
CLOSE = 1e-3  # of a step after its start: that is where it had to begin


@dataclass(frozen=True)
class Onset:
    """An instant at which a load is not smooth.

    Attributes:
        t: Time [s]; just after a jump.
        jumps: Whether the load jumps there, in place of bending.
    """

    t: float
    jumps: bool


class Onsets:
    """Looks for them among those loads of a scene that are functions of a user's."""

    def __init__(self, scene: Scene) -> None:
        """Collect these loads.

        Args:
            scene: The problem.
        """
        self._comm = scene.comm
        loads = [load for load in scene.named(Windowed) if load.is_load and _is_given(load)]
        self._loads = [load for load in loads if type(load).signal is not Effect.signal]
        # The least and the largest value so far of each component.
        self._range: list[tuple[Array, Array] | None] = [None] * len(self._loads)

    def within(self, t: float, end: float, tol: float) -> Onset | None:
        """The first in a step that matters; None if there is none. Collective.

        Args:
            t: Start of the step [s].
            end: Its end [s].
            tol: Error of a load in the mean that does not matter, over what its components have
                changed by so far.

        Raises:
            SceneError: On every rank, if a load's function fails on any.
        """
        if not self._loads:
            return None

        def first() -> Onset | None:
            found = None
            for k in range(len(self._loads)):
                found = self._first_of(k, t, end if found is None else found.t, tol) or found
            return found

        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        return self._comm.bcast(together(self._comm, "A load", first))

    def _first_of(self, k: int, t: float, end: float, tol: float) -> Onset | None:
        """The first of one load."""
        load, found = self._loads[k], None

        def q(time: float) -> Array:
            value = by_name(load.owner, time, partial(load.signal, time, end - t))
            return np.asarray(value, dtype=np.float64)

        for _ in range(SEVERAL):
            times = t + PLACES * (end - t)
            values = [q(float(time)) for time in times]
            off, swing = self._off(k, values)
            if off <= tol:
                return found
            one = narrowed(q, times, values)
            if one is None:
                return self._calm(k, q, t, end, swing) or found
            if not t + CLOSE * (end - t) < one.t < end:
                return found
            found, end = one, one.t
        return found

    def _calm(
        self, k: int, q: Callable[[float], Array], t: float, end: float, swing: float
    ) -> Onset | None:
        """The end of a step in which a smooth load does not swing to and fro; None if it does not.

        Args:
            k: Number of the load.
            q: The load.
            t: Start of the step [s].
            end: Its end [s].
            swing: See `_off`.
        """
        whole = end
        for _ in range(SHORTER):
            if swing <= SWINGS:
                break
            end = (t + end) / 2
            _, swing = self._off(k, [q(float(time)) for time in t + PLACES * (end - t)])
        return Onset(end, jumps=False) if end < whole else None

    def _off(self, k: int, values: list[Array]) -> tuple[float, float]:
        """By how much the mean of a load is off its middle, over what it has changed by so far.

        Returns:
            The most of any component; and of any that turns within the step.
        """
        if len({value.shape for value in values}) > 1:
            return 0.0, 0.0  # the step says what is wrong
        every, known = np.array(values), self._range[k]
        least, most = every.min(axis=0), every.max(axis=0)
        if known is not None and known[0].shape == least.shape:
            least, most = np.minimum(least, known[0]), np.maximum(most, known[1])
        self._range[k] = least, most
        if not np.isfinite([least, most]).all():
            return 0.0, 0.0  # and of that
        changed, size = (most - least).ravel(), np.maximum(np.abs(least), np.abs(most)).ravel()
        off = np.abs(SIMPSON @ every.reshape(5, -1) - every[2].ravel())
        moves = changed > np.maximum(ROUNDING * size, LEAST)
        part = np.divide(off, changed, out=np.zeros_like(off), where=moves)
        rising = np.diff(every.reshape(5, -1), axis=0) > 0
        turns = rising.any(axis=0) & ~rising.all(axis=0)
        return float(part.max(initial=0.0)), float(part[turns].max(initial=0.0))


def narrowed(q: Callable[[float], Array], times: Array, values: list[Array]) -> Onset | None:
    """Where a function is least smooth; None if it is smooth there.

    Args:
        q: The function of time.
        times: Some times, evenly apart, shape (5,) [s].
        values: Its values there, each of the same shape.
    """
    first = bend = 0.0
    for halvings in range(HALVINGS + 1):
        bends = [
            float(np.linalg.norm(values[k - 1] - 2 * values[k] + values[k + 1])) for k in (1, 2, 3)
        ]
        k = int(np.argmax(bends)) + 1
        bend, first = bends[k - 1], first or bends[k - 1]
        if SCATTER * bend <= first * 2.0 ** (-SMOOTH * halvings):
            return None
        (a, b, c), (qa, qb, qc) = times[k - 1 : k + 2], values[k - 1 : k + 2]
        times = np.array([a, (a + b) / 2, b, (b + c) / 2, c])
        values = [qa, np.asarray(q(float(times[1]))), qb, np.asarray(q(float(times[3]))), qc]
    jumps = bend > first * 2.0 ** (-SHARP * HALVINGS)
    later = np.linalg.norm(qc - qb) > np.linalg.norm(qb - qa)
    return Onset(float(c if jumps and later else b), jumps)


def _is_given(load: Windowed) -> bool:
    """Whether a load has a function of a user's, of which not all is known."""
    given = [getattr(load, own.name) for own in fields(load)]
    return any(is_function(value) and not isinstance(value, Table) for value in given)

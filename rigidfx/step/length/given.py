"""Loads that are functions of a user's, as they are evaluated before a step is made.

A load of time alone has some components. One of place and time is evaluated at all nodes that it
acts on, or at a thousand that stand for them, spread evenly by their places; by each rank at all of
these, so that ranks decide alike with nothing sent. Nodes count by their weights, as their forces
do: a jump at a few of many nodes changes the motion by as little.
"""

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from math import ceil, nan
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, by_name, together
from rigidfx.base.inputs import is_function
from rigidfx.base.instants import longer
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Effect, Table, Windowed
from rigidfx.scene.points import spread
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

Signal = Callable[[float, float], npt.ArrayLike]

NODES = 1000  # at which a function of place is evaluated, at most
ROUNDING = 1e-12  # of a component's size, by which none has changed
SMOOTH = 0.05  # of its change, by which the middle of a smooth load may be off its mean
# Of a step: so far from its ends loads are evaluated, where windows may begin or end, and so close
# bisection finds its end.
INSIDE = 1e-6
AHEAD = 1e-4  # of a step, the length for which a path gives its velocity: not to see beyond its end
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
        """Add a time [s] as a breakpoint."""
        self._event = event

    def meets(self, t: float) -> bool:
        """Whether a breakpoint is at a time [s]."""
        return any(self._timeline.same(t, b) for b in (*self._breaks, self._event))

    def forget(self) -> None:
        """Divide what is left anew."""
        self._stop = nan

    def end(self, t: float, dt: float, longest: float, tol: float) -> float:
        """End of a step of Δt from t, with no other reason to end [s]."""
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


class Given:
    """A load, and the range of its values so far.

    Attributes:
        owner: Its name.
        start: When it begins to act [s].
        led: Whether it is the velocity of a path.
        weights: Of its points.
    """

    remembered: ClassVar[Remembered] = same("_range", "_changed", "_asked")

    def __init__(self, load: Windowed, scene: Scene, signal: Signal | None = None) -> None:
        """Nothing has been evaluated of a load, or of a signal in its place. Collective."""
        self._load: Any = load
        self._signal = load.signal if signal is None else signal
        self.owner, self.start = load.owner, load.start
        self._X, self.weights = np.zeros((0, 3)), np.ones(1)
        self.led = load.is_support or load.prescribes
        self._range: tuple[Array, Array] | None = None
        self._asked, self._changed = False, np.zeros(1)
        if load.is_dead and not load.uniform:
            weights = self._load.weights(scene)[: scene.owned_nodes]
            nodes = np.flatnonzero(weights)
            X = scene.space.tabulate_dof_coordinates()[nodes]
            some = spread(scene.comm, X, NODES)
            self._X = np.concatenate(scene.comm.allgather(X[some]))
            self.weights = np.concatenate(scene.comm.allgather(np.abs(weights[nodes[some]])))

    def off(self, t: float, end: float, tol: float) -> float:
        """By how much its mean over a step is wrong, over what it may be; zero if it has none.

        The tolerance is relative to the change of the load so far. A load that fails, or gives
        something else when first asked again, is a `SceneError` on this rank.
        """
        length = end - t
        dt = AHEAD * length if self.led else length
        times = [t + length * (INSIDE + k * (1 - 2 * INSIDE) / 4) for k in range(5)]
        values = [self.at(time, dt) for time in times]
        if not self._asked and self._load.acts(times[0]):
            self._asked = True
            self.ask_again(times[0], dt)
        if {value.shape for value in values} != {(self.weights.size, values[0].shape[-1])}:
            return 0.0
        every = np.array(values)
        least, most = every.min(axis=0), every.max(axis=0)
        if self._range is not None and self._range[0].shape == least.shape:
            least, most = np.minimum(least, self._range[0]), np.maximum(most, self._range[1])
        self._range = least, most
        if not np.isfinite([least, most]).all():
            return 0.0
        by = most - least
        self._changed = self.weights @ (by * (by > ROUNDING * np.maximum(-least, most)))
        start, second, middle, fourth, last = every  # for Simpson's means of five and of three
        mean = (start + 4 * second + 2 * middle + 4 * fourth + last) / 12
        coarse = (start + 4 * middle + last) / 6
        off, rough = map(float, self._parts(np.array([mean - middle, mean - coarse])))
        return max(off / max(tol, SMOOTH), rough / min(tol, SMOOTH))

    def jumps(self, before: float, after: float) -> bool:
        """Whether it jumps between two times [s] that are close to each other."""
        dt = after - before
        self.ask_again(after, dt)
        return bool(self._parts(self.at(after, dt) - self.at(before, dt)) > SMOOTH)

    def _parts(self, off: Array) -> Array:
        """Differences over the change of the load: the most of any component."""
        sums = self.weights @ np.abs(off)
        part = np.divide(sums, self._changed, out=np.zeros_like(sums), where=self._changed > 0)
        return np.asarray(part.max(axis=-1, initial=0.0))

    def ask_again(self, t: float, dt: float) -> None:
        """See whether it gives the same twice at t in a step of Δt [s], or raise a `SceneError`."""
        before, again = self.at(t, dt), self.at(t, dt)
        if again.shape != before.shape or np.array_equal(again, before, equal_nan=True):
            return
        k = np.unravel_index(np.argmax(again != before), again.shape)
        raise SceneError(
            f"{self._load.owner}: asked twice at t = {t:g} s its function gives {before[k]:g} and "
            f"{again[k]:g}. Steps are chosen by what loads will be, so a function has to give one "
            "value at one time: draw random numbers before the run, and look them up, as a Table "
            "does."
        )

    def at(self, t: float, dt: float) -> Array:
        """Its value at t in a step of Δt [s], shape (points, components), or a `SceneError`."""
        array = np.array(
            by_name(self._load.owner, t, partial(self._value, t, dt)), dtype=np.float64
        )
        return array if len(self._X) else array.reshape(1, -1)

    def _value(self, t: float, dt: float) -> Array:
        load = self._load
        if load.is_dead and not load.uniform:
            return load.intensity(t, self._X)
        return np.atleast_1d(self._signal(t, dt))


def given_loads(scene: Scene) -> list[Given]:
    """The loads of a scene that are a user's functions, of which not all is known. Collective."""
    loads = [load for load in scene.named(Windowed) if load.is_load and is_given(load)]
    return [Given(load, scene) for load in loads if type(load).signal is not Effect.signal]


def is_given(load: Windowed) -> bool:
    """Whether a load has a function of a user's."""
    given = [getattr(load, own.name) for own in fields(load)]
    return any(is_function(value) and not isinstance(value, Table) for value in given)


class Onset(NamedTuple):
    """Time t [s] at which a step has to end.

    `jumps` if a load jumps just before it, `led` if that is the velocity of a support's path.
    """

    t: float
    jumps: bool = False
    led: bool = False


class Onsets:
    """Finds such times among the loads of a scene that are functions of the user's.

    The jerk of the motion shows the error of a step for smooth loads, but not for a load that jumps
    or begins after the middle: docs/theory/time_steps.md, (9).

    Time windows, kinks of a `Table` and `breakpoints` are known without this. A sine of two steps a
    period may be zero at all middles and in all means, and is missed.
    """

    remembered: ClassVar[Remembered] = same() | {"_loads": PART}

    def __init__(self, scene: Scene) -> None:
        """Collect these loads. Collective."""
        self._comm, self._loads = scene.comm, given_loads(scene)

    def within(self, t: float, end: float, shortest: float, tol: float) -> Onset | None:
        """Time at which a step has to end early; None if it may be whole. Collective.

        The shortest step is always short enough [s]; errors of a load's mean up to a tolerance,
        over its change so far, do not matter. A load that fails is a `SceneError` on every rank.
        """
        if not self._loads:
            return None

        def first() -> Onset | None:
            found = [_end_of(given, t, end, shortest, tol) for given in self._loads]
            return min((onset for onset in found if onset), default=None)

        # Functions cannot be compared: were theirs to differ, so would what ranks decide by them.
        return self._comm.bcast(together(self._comm, "A load", first))


def _end_of(given: Given, t: float, end: float, shortest: float, tol: float) -> Onset | None:
    """Where a step has to end for the sake of one load; None if it has not."""
    if given.off(t, end, tol) <= 1:
        return None
    good, last = t, end
    while last - good > INSIDE * (end - t):
        middle = (good + last) / 2
        good, last = (middle, last) if given.off(t, middle, tol) <= 1 else (good, middle)
    jumps = given.jumps(good - 2 * INSIDE * (good - t), last)  # no sample is nearer to an end
    return Onset(min(max(last if jumps else good, t + shortest), end), jumps, given.led and jumps)

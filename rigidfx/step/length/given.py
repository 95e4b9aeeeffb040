"""Loads that are functions of a user's, as they are evaluated before a step is made.

A load of time alone has some components. One of place and time is evaluated at all nodes that it
acts on, or at a thousand that stand for them, spread evenly by their places; by each rank at all of
these, so that ranks decide alike with nothing sent. Nodes count by their weights, as their forces
do: a jump at a few of many nodes changes the motion by as little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, by_name
from rigidfx.base.inputs import is_function
from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Effect, Table, Windowed
from rigidfx.scene.sample import spread
from rigidfx.scene.scene import Scene

__all__ = ["Given", "given_loads", "is_given"]

Signal = Callable[[float, float], npt.ArrayLike]

NODES = 1000  # at which a function of place is evaluated, at most
ROUNDING = 1e-12  # of a component's size, by which none has changed
SMOOTH = 0.05  # of its change, by which the middle of a smooth load may be off its mean
INSIDE = 1e-6  # of a step: so far from its ends loads are evaluated, where windows may begin or end
AHEAD = 1e-4  # of a step, the length for which a path gives its velocity: not to see beyond its end


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
        """Nothing has been evaluated. Collective.

        Args:
            load: The load.
            scene: The scene that names it.
            signal: Its value by t and Δt [s]; its `signal` if None.
        """
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

        Args:
            t: Start of the step [s].
            end: Its end [s].
            tol: Error of the mean that does not matter, over the change of the load so far.

        Raises:
            SceneError: On this rank, if it fails, or gives something else when first asked again.
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
        """Ratio of differences to the change of the load: the most of any component.

        Args:
            off: Shape (..., nodes, components).
        """
        sums = self.weights @ np.abs(off)
        part = np.divide(sums, self._changed, out=np.zeros_like(sums), where=self._changed > 0)
        return np.asarray(part.max(axis=-1, initial=0.0))

    def ask_again(self, t: float, dt: float) -> None:
        """See whether it gives the same twice.

        Args:
            t: Time [s].
            dt: Length of a step [s].

        Raises:
            SceneError: On this rank, if not.
        """
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
        """Its value, shape (points, components), also where that is none that can be used.

        Args:
            t: Time [s].
            dt: Length of a step [s].

        Raises:
            SceneError: On this rank, if its function fails.
        """
        array = np.array(
            by_name(self._load.owner, t, partial(self._value, t, dt)), dtype=np.float64
        )
        return array if len(self._X) else array.reshape(1, -1)

    def _value(self, t: float, dt: float) -> Array:
        load = self._load
        if load.is_dead and not load.uniform:
            return load.intensities(t, self._X)
        return np.atleast_1d(self._signal(t, dt))


def given_loads(scene: Scene) -> list[Given]:
    """The loads of a scene that are a user's functions, of which not all is known. Collective."""
    loads = [load for load in scene.named(Windowed) if load.is_load and is_given(load)]
    return [Given(load, scene) for load in loads if type(load).signal is not Effect.signal]


def is_given(load: Windowed) -> bool:
    """Whether a load has a function of a user's."""
    given = [getattr(load, own.name) for own in fields(load)]
    return any(is_function(value) and not isinstance(value, Table) for value in given)

"""Loads that are functions of a user's, as they are asked before a step is made.

One of time alone has some components. One of place and time is asked at all nodes that it acts on,
or at a thousand that stand for them, spread evenly by their places; by each rank at all of these,
so that ranks decide alike with nothing sent. What its nodes change by is added up by their weights,
as its forces are: what jumps at a few of many nodes changes the motion by as little.
"""

from __future__ import annotations

from dataclasses import fields
from functools import partial
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError, by_name
from rigidfx.base.inputs import is_function
from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import DeadLoad, Effect, Table, Windowed
from rigidfx.scene.sample import spread
from rigidfx.scene.scene import Scene

__all__ = ["Given", "given_loads"]

Array = npt.NDArray[np.float64]

NODES = 1000  # at which a function of place is asked, at most
ROUNDING = 1e-12  # of a component's size, by which none has changed
LEAST = float(np.finfo(float).tiny / np.finfo(float).eps)  # numbers below have fewer digits


class Given:
    """A load, and its change so far.

    Attributes:
        load: The load.
        changed: By how much each component, the sum over nodes by their weights.
    """

    remembered: ClassVar[Remembered] = same("_range", "_asked", "changed")

    def __init__(self, load: Windowed, scene: Scene) -> None:
        """Nothing has been asked. Collective.

        Args:
            load: The load.
            scene: The scene that names it.
        """
        self.load, self._X, self._weights = load, np.zeros((0, 3)), np.ones(1)
        self._owner = load.owner
        self._range: tuple[Array, Array] | None = None
        self._asked = False
        self.changed: Array = np.zeros(1)
        if isinstance(load, DeadLoad) and not load.uniform:
            weights = load.weights(scene)[: scene.owned_nodes]
            nodes = np.flatnonzero(weights)
            X = scene.space.tabulate_dof_coordinates()[nodes]
            some = spread(scene.comm, X, NODES)
            self._X = np.concatenate(scene.comm.allgather(X[some]))
            self._weights = np.concatenate(scene.comm.allgather(np.abs(weights[nodes[some]])))

    def at(self, t: float, dt: float) -> Array:
        """Its value, shape (nodes, components); NaN where the result has another shape.

        Args:
            t: Time [s].
            dt: Length of a step [s].

        Raises:
            SceneError: On this rank, if it fails, or gives something else when first asked again.
        """
        value = self._once(t, dt)
        if not self._asked and self.load.acts(t):
            self._asked = True
            self.ask_again(t, dt, value)
        return value

    def ask_again(self, t: float, dt: float, before: Array) -> None:
        """See whether it gives the same when asked again.

        Args:
            t: Time [s].
            dt: Length of a step [s].
            before: The result.

        Raises:
            SceneError: On this rank, if not.
        """
        again = self._once(t, dt)
        if again.shape != before.shape or np.array_equal(again, before, equal_nan=True):
            return
        k = np.unravel_index(np.argmax(again != before), again.shape)
        raise SceneError(
            f"{self.load.owner}: asked twice at t = {t:g} s its function gives {before[k]:g} and "
            f"{again[k]:g}. Steps are chosen by what loads will be, so a function has to give one "
            "value at one time: draw random numbers before the run, and look them up, as a Table "
            "does."
        )

    def _once(self, t: float, dt: float) -> Array:
        value = by_name(self._owner, t, partial(self._value, t, dt))
        array = np.array(value, dtype=np.float64)  # a function may give the same array each time
        return array if len(self._X) else array.reshape(1, -1)

    def _value(self, t: float, dt: float) -> Array:
        load = self.load
        if isinstance(load, DeadLoad) and not load.uniform:
            return load.intensities(t, self._X)
        return load.signal(t, dt)

    def known(self, values: list[Array]) -> Array | None:
        """Take values of a step into its change.

        Returns:
            All of them, shape (values, nodes, components); None if they are not finite, or not as
            many: the step says the fault.
        """
        shapes = {value.shape for value in values}
        if len(shapes) > 1 or values[0].ndim != 2 or len(values[0]) != self._weights.size:
            return None
        every = np.array(values)
        least, most = every.min(axis=0), every.max(axis=0)
        if self._range is not None and self._range[0].shape == least.shape:
            least, most = np.minimum(least, self._range[0]), np.maximum(most, self._range[1])
        self._range = least, most
        if not np.isfinite([least, most]).all():
            return None
        size, by = np.maximum(-least, most), most - least
        self.changed = self._weights @ (by * (by > np.maximum(ROUNDING * size, LEAST)))
        return every

    def part(self, off: Array) -> float:
        """Ratio of a difference to the change of the load: the most of any component.

        Args:
            off: Of each node and component, shape (nodes, components).
        """
        sums, moves = self._weights @ np.abs(off), self.changed > 0
        part = np.divide(sums, self.changed, out=np.zeros_like(sums), where=moves)
        return float(part.max(initial=0.0))


def given_loads(scene: Scene) -> list[Given]:
    """The loads of a scene that are a user's functions, of which not all is known. Collective."""
    loads = [load for load in scene.named(Windowed) if load.is_load and _is_given(load)]
    return [Given(load, scene) for load in loads if type(load).signal is not Effect.signal]


def _is_given(load: Windowed) -> bool:
    """Whether a load has a function of a user's."""
    given = [getattr(load, own.name) for own in fields(load)]
    return any(is_function(value) and not isinstance(value, Table) for value in given)

"""Strain rates of u + e in flexible cells."""

from __future__ import annotations

from typing import ClassVar

from dolfinx import fem

from rigidfx.base.remembered import FIELD, Remembered, same
from rigidfx.base.types import Array
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import Cells

__all__ = ["SharedStrains"]


class SharedStrains:
    """Measures them from step to step."""

    remembered: ClassVar[Remembered] = same("_known") | {"_end": FIELD}

    def __init__(self, space: fem.FunctionSpace, indicator: Indicator) -> None:
        """Measure nothing yet.

        Args:
            space: Space of the displacements.
            indicator: A measure of its own.
        """
        self._start, self._end = fem.Function(space), fem.Function(space)
        self._indicator, self._known = indicator, False

    def bind(self, cells: Cells) -> None:
        """Measure these owned cells from now on, by subdomain id."""
        self._indicator.bind(cells, (self._start, self._end))

    def step(self, moved: Array | None, dt: float) -> Array | None:
        """Strain rates of a step that ends with given displacements. Collective.

        Args:
            moved: u + e at the owned nodes, shape (nodes, 3) [m]; None if e is not known.
            dt: Length of the step [s].

        Returns:
            Of each owned cell, zero in rigid ones [1/s]; None where the start is not known.
        """
        known, self._known = self._known, moved is not None
        if moved is None:
            return None
        self._start.x.array[:] = self._end.x.array
        self._end.x.array[: moved.size] = moved.reshape(-1)
        self._end.x.scatter_forward()
        if not known:
            return None
        self._indicator.measure(dt)
        return self._indicator.values.copy()

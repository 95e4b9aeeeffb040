"""What the cells of bodies strain, and how far they bend, as their shadows move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from rigidfx.flexible.indicator import Indicator
from rigidfx.shadow.hanging import Hanging
from rigidfx.shadow.margin import Margin
from rigidfx.shadow.motion import Limits, Motion, Strained, part_of
from rigidfx.shadow.parts import Parts

__all__ = ["Gauge"]

Array = npt.NDArray[np.float64]

# Looks after a change of the bodies in which the shadow alone tells: where cells have just become
# flexible, or rigid, steady forces would have to be those of that change.
UNSETTLED = 4

# Part of a change of shape that is measured: a shadow is linear, but where bodies grow together it
# turns by what they had turned against each other, and the strain of that is of second order.
LITTLE = 2.0**-8


class Gauge:
    """Measures what cells strain by changes of the shape that their bodies are frozen in.

    Attributes:
        looks: How often shadows have been looked at since the bodies have changed.
    """

    def __init__(self, space: fem.FunctionSpace, indicator: Indicator) -> None:
        """Measure nothing yet. Collective.

        Args:
            space: Space of the displacements.
            indicator: A measure of its own for the bodies' cells.
        """
        self.looks = 0
        self._indicator = indicator
        self._ends = fem.Function(space), fem.Function(space)
        self._parts: Parts | None = None
        self._inside: npt.NDArray[np.int64] = np.empty(0, np.int64)
        self._find_hanging: Callable[[], Hanging] | None = None
        self._hanging: Hanging | None = None

    def bind(self, margin: Margin, shape: fem.Function, hanging: Callable[[], Hanging]) -> None:
        """Measure the cells of some bodies from now on. Collective.

        Args:
            margin: The bodies, and what gives way with them.
            shape: Displacements of the shape that they are frozen in [m].
            hanging: Finds what hangs on them, once that is asked for. Collective.
        """
        self.looks, self._parts, self._inside = 0, margin.parts, margin.inside
        self._find_hanging, self._hanging = hanging, None
        self._ends[0].x.array[:] = shape.x.array
        self._indicator.bind(margin.parts.cells, self._ends)

    def strained(
        self,
        start: Motion,
        end: Motion,
        dt: float,
        limits: Limits,
        before: Strained | None,
        *,
        struck: bool = False,
    ) -> Strained:
        """What each owned cell would strain in a step, and before. Collective.

        Args:
            start: The shadows at the start of the step.
            end: The same at its end.
            dt: Its length [s].
            limits: What wakes cells.
            before: What cells would strain in steps before this one; None if there are none.
            struck: Whether loads are known to change in it, of which all of a rate tells at once.
        """
        known = ~np.isnan(start.mean)
        total = self._measured(np.where(known, end.mean, 0.0), 1.0)
        if limits.rates is None:
            rate = spring = np.zeros_like(total)
        else:
            rate = part_of(self._rates(start, end, dt, struck), limits.rates)
            spring = part_of(total, dt * limits.rates)
        rate, swings = rate if before is None else np.maximum(rate, before.rate), limits.swings
        swing = None if swings is None else part_of(self._measured(end.u, 1.0), swings)
        bend = None if limits.bends is None else part_of(self._bent(end.u), limits.bends)
        withheld, timed = part_of(total, limits.strains), limits.rates is not None
        return Strained(rate, withheld, spring, swing, bend, by_rates=timed, window=limits.window)

    def _rates(self, start: Motion, end: Motion, dt: float, struck: bool) -> Array:
        """Strain rate of each owned cell in a step [1/s]. Collective."""
        slow = self._measured(np.where(np.isnan(start.mean), 0.0, end.mean - start.mean), dt)
        # What a step does not resolve rings from step to step: nothing is left of two together. A
        # change of the bodies sets that off, in what is flexible beside them, too.
        both = dt * (start.w + end.w) * (1.0 if struck or self.looks > UNSETTLED else 0.5)
        lasting = self._measured(np.where(np.isnan(both), 0.0, both), dt)
        rates = np.minimum(self._measured(end.u - start.u, dt), lasting)
        return np.maximum(rates, slow) if self.looks > UNSETTLED else rates

    def _bent(self, u: Array) -> Array:
        """Largest displacement of each owned cell's nodes but for its body's motion. Collective.

        Or how far its body carries what hangs on it, if that is more.
        """
        assert self._parts is not None
        assert self._find_hanging is not None
        if self._hanging is None:
            self._hanging = self._find_hanging()
        rows, field = self._parts.rows, self._ends[1]
        field.x.array[:] = 0.0
        field.x.array[rows.dofs] = self._parts.unmoved(u[self._inside]).reshape(-1)
        field.x.scatter_forward()
        far = np.linalg.norm(field.x.array.reshape(-1, 3), axis=1)
        out = np.zeros(self._indicator.values.size)
        cells = self._indicator.cells
        out[cells] = far[field.function_space.dofmap.list[cells]].max(axis=1, initial=0.0)
        carried = self._hanging.carried(u[self._inside])
        for data, most in zip(self._parts.bodies, carried, strict=True):
            out[data.cells] = np.maximum(out[data.cells], most)
        return out

    def _measured(self, change: Array, dt: float) -> Array:
        """Strain rates of all owned cells, for a change of the frozen shape. Collective."""
        assert self._parts is not None
        shape, end = (f.x for f in self._ends)
        dofs = self._parts.rows.dofs
        end.array[:] = shape.array
        end.array[dofs] += LITTLE * change[self._inside].reshape(-1)
        end.scatter_forward()
        self._indicator.measure(LITTLE * dt)
        return self._indicator.values.copy()

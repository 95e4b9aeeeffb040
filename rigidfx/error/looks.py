"""Advances the error motion before a step is accepted, and finds the cells that wake.

Strain rates of u + e in flexible cells are measured with it. Strains of e are measured in one of
four steps while they are small.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.remembered import CELLS, FIELD, ON_CELLS, ON_NODES, PART, Remembered, same
from rigidfx.base.types import Array, Indices
from rigidfx.error.error_motion import LOOKS, ErrorMotion
from rigidfx.error.strained import Limits, Strained, part_of
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import Cells
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch
from rigidfx.withheld.body_forces import BodyForces

__all__ = ["Looks"]

CALM = 0.5  # part of the rate that wakes cells, below which a look in several steps is enough
ALARM = 2.0  # times the largest recent change of ρ in a step: a force that is new is looked at
RECENT = 8  # steps whose changes count


class Pace:
    """Says whether bodies are far from waking.

    Attributes:
        ratio: Largest strain rate of e in rigid cells at the last look, over the rate that wakes.
    """

    remembered: ClassVar[Remembered] = same("_alarmed", "_waited", "ratio", "_bodies", "_changes")
    remembered |= {"_last": ON_NODES}

    def __init__(self, forces: BodyForces, nodes: int) -> None:
        """Nothing has been looked at.

        Args:
            forces: Knows ρ.
            nodes: How many nodes this rank owns.
        """
        self._forces, self._nodes = forces, nodes
        self._last: Array | None = None  # ρ of the step before, at these nodes [N] ...
        self._bodies: tuple[int, ...] = ()  # ... and the numbers of its bodies
        self._changes: tuple[float, ...] = ()
        self._alarmed, self._waited = True, 0
        self.ratio = 1.0

    @property
    def calm(self) -> bool:
        """Whether e strains rigid cells little, and no force is new."""
        return self.ratio <= CALM and not self._alarmed

    def follow(self) -> None:
        """Compare ρ of an attempt with that of the step before. Collective."""
        before, of = self._last, self._bodies
        self._last, self._bodies, self._alarmed = None, (), True
        if self._forces.borne is not None:
            parts, force = self._forces.borne
            self._bodies = tuple(body.number for body in parts.bodies)
            self._last = np.zeros((self._nodes, 3))
            self._last[parts.rows.nodes] = force
        if self._last is None or before is None or of != self._bodies:
            self._changes = ()
            return
        change = parts.size(force - before[parts.rows.nodes])
        self._alarmed = not self._changes or change > ALARM * max(self._changes)
        self._changes = (*self._changes, change)[-RECENT:]

    @property
    def looked(self) -> bool:
        """Whether the last step had a look."""
        return self._waited == 0

    def due(self) -> bool:
        """Whether a look is due at this step of e."""
        self._waited = 0 if not self.calm or self._waited + 1 >= LOOKS else self._waited + 1
        return self._waited == 0


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


class Looks(Watch):
    """Asks e which rigid cells it strains too fast, and the strains of flexible ones in u + e.

    Attributes:
        withheld: Strain energy that bodies withhold, at the last look [J].
    """

    remembered: ClassVar[Remembered] = same("withheld", "_since") | {"_pace": PART, "_shared": PART}
    remembered |= {"_rigid": CELLS, "_rates": ON_CELLS}

    def __init__(
        self, stepper: Stepper, forces: BodyForces, error: ErrorMotion, indicator: Indicator
    ) -> None:
        """Look at nothing yet.

        Args:
            stepper: Solves the steps.
            forces: Knows ρ.
            error: The error motion.
            indicator: A measure of its own for flexible cells.
        """
        self._stepper, self._forces, self._error = stepper, forces, error
        self._shared = SharedStrains(stepper.scene.space, indicator)
        self._owned = indicator.values.size
        self._rigid: Indices = np.empty(0, np.int32)
        self._pace = Pace(forces, stepper.scene.owned_nodes)
        self.withheld = 0.0
        self._since = 0.0  # time since the last measure of u + e [s]
        self._rates: Array | None = None  # of u + e, then

    def bind(self, flexible: Cells) -> None:
        """See `Watch`."""
        every, before = np.arange(self._owned, dtype=np.int32), self._rigid
        self._rigid = np.setdiff1d(every, np.concatenate([every[:0], *flexible.values()]))
        self._shared.bind(flexible)
        kept = np.array_equal(before, self._rigid)
        if not self._stepper.scene.comm.allreduce(kept, op=MPI.LAND):
            self._rates = None

    def look(self, attempt: Attempt, limits: Callable[[], Limits] | None = None) -> Strained | None:
        """Strains of e in rigid cells in a step that has been solved. Collective.

        Args:
            attempt: The step.
            limits: Gives the rates that wake cells; None where none may wake any more in this step.

        Returns:
            Over the rate that wakes cells; None where none wakes. Infinite where e is not small and
            strains a cell by more than a window at the rate that wakes it.
        """
        stepped = self._error.look(attempt)
        self._pace.follow()
        due = self._pace.due() or not self._error.validity.holds.all()
        if not stepped or limits is None or self._forces.borne is None or not due:
            return None
        known = limits()
        none: Array = np.zeros(self._owned)
        size = self._error.size() if np.isfinite(known.size) else 0.0
        rate = spring = none
        if known.rates is not None:
            rate = part_of(self._of_all(self._error.rates(self._rigid)), known.rates)
            rate[self._beyond(known.rates * known.window)] = np.inf
        here = max(float(rate.max(initial=0.0)), size / known.size)
        self._pace.ratio = self._stepper.scene.comm.allreduce(here, op=MPI.MAX)
        if not self._pace.ratio > 1:
            return None
        strain = self._of_all(self._error.strains(self._rigid))
        if known.rates is not None:
            spring = part_of(strain, attempt.dt * known.rates)
        return Strained(rate, spring, strain, known.window)

    def _beyond(self, most: Array) -> Indices:
        """Rigid cells in which e is not small, and strains by more than `most` [-]. Collective."""
        if self._error.validity.holds.all():
            return self._rigid[:0]
        large = np.intersect1d(self._error.validity.concerned, self._rigid)
        return large[part_of(self._of_all(self._error.strains(self._rigid)), most)[large] > 1]

    def _of_all(self, strains: Array) -> Array:
        """Strains of rigid cells, of all owned cells; zero in flexible ones."""
        out = np.zeros(self._owned)
        out[self._rigid] = strains
        return out

    def shared(self, dt: float) -> Array | None:
        """Strain rate of u + e since the last look, of each owned cell [1/s]. Collective.

        Args:
            dt: Length of the step of the run [s].

        Returns:
            None where e is zero or not known, or was so then.
        """
        self._since += dt
        if self._rates is not None and not self._pace.looked:
            return self._rates
        shown, state = self._error.shown(), self._stepper.state
        moved = None
        if shown is not None:
            moved = state.places - state.X[: len(state.places)] + shown.displacement
        self._rates, self._since = self._shared.step(moved, self._since), 0.0
        self.withheld = self._error.withheld()
        return self._rates

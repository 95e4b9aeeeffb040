"""Advances the error motion before a step is accepted, and finds the cells that wake."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import CELLS, ON_CELLS, PART, Remembered, same
from rigidfx.base.types import Array, Indices
from rigidfx.error.error_motion import ErrorMotion
from rigidfx.error.forces.body_forces import BodyForces
from rigidfx.error.pace import Pace
from rigidfx.error.shared_strains import SharedStrains
from rigidfx.error.strained import Limits, Strained, part_of
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import Cells
from rigidfx.step.stepper import Stepper
from rigidfx.step.watches.judge import Attempt, Watch

__all__ = ["Looks"]


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

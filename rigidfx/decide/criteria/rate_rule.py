"""The rule of `StrainRate`: a tolerance of each cell, the same at a freeze and at waking."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.decide.criteria.concentration import stiffness
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.criteria.relative import Relative
from rigidfx.decide.criteria.rule import Waking
from rigidfx.decide.criteria.tolerances import Tolerances
from rigidfx.decide.criteria.window_length import MARGIN, window_length
from rigidfx.decide.memory.bends import FAST
from rigidfx.decide.memory.memory import Memory
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.shadow.motion import Limits, Strained

__all__ = ["HALF", "RateRule"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

HALF = 0.5  # of what wakes cells, that drift or freezes may make of rates: there is more
JUST = 1.5  # steps since loads were seen to change, as they are after a step


class RateRule:
    """Cells are quiet up to a strain rate, and wake above κ times that."""

    remembered: ClassVar[Remembered] = same("_noise")

    def __init__(
        self,
        scene: Scene,
        timeline: Timeline,
        memory: Memory,
        tol: float | Relative,
        tolerances: Mapping[str, float],
        window: float | Literal["auto"],
        kappa: float | None,
    ) -> None:
        """Find the cells that have a tolerance of their own. Collective.

        Args:
            scene: The problem.
            timeline: Where steps end.
            memory: What the policy remembers.
            tol: See `rigidfx.decide.criteria.criterion.StrainRate`, as of all that follows.
            tolerances: Of named sets of cells.
            window: Length of a window [s].
            kappa: Factor of waking; None if forces wake nothing.

        Raises:
            SceneError: If a name is unknown.
        """
        self._comm, self._timeline, self._memory = scene.comm, timeline, memory
        self._tol, self._window, self._kappa = tol, window, kappa
        self._tolerances = Tolerances(scene, memory, tol, tolerances)
        self._stiffness = stiffness(scene)
        self._noise = 0.0  # strain rate that rounding may leave, at the end of the last window

    @property
    def tol(self) -> Array:
        """Tolerance of each owned cell now [1/s]."""
        return self._tolerances.now()

    def limits(self) -> Limits:
        """What wakes cells: strains of a window, of a stroke, or of a step while none is known."""
        window = self._window
        period = MARGIN * self._memory.signals.period() if isinstance(window, str) else window
        length = float(period) if period > 0 else np.inf  # nothing may oscillate yet, or at all
        # What is at rest strains by noise: with a tolerance below that it would wake at once.
        rates = (self._kappa or 1.0) * np.maximum(self.tol, self._noise)
        strokes, bends = self._memory.strokes, self._memory.bends
        times = strokes.of_strains(length, self._timeline.dt, once=bends.together > 1)
        return Limits(rates, rates * times, length, bends=bends.limits(self.tol))

    @property
    def rigidity(self) -> None:
        """Not estimated: tolerances are the user's."""
        return None

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        return window_length(self._window, self._memory)

    def observe(self, seen: Observation) -> None:
        """Remember the largest strain rates. Collective."""
        memory, indicator = self._memory, seen.indicator
        looks = memory.strokes.add(indicator.values, seen.t - seen.dt, seen.t)
        if looks and self._kappa is not None and not seen.flies_rigid:
            memory.strokes.swing(indicator.cells, seen.strains)
            memory.bends.add(seen.state, seen.held)
        rested = seen.t - memory.loads.resting_since
        if seen.energies is not None and rested < JUST * seen.dt:
            memory.drift.add(*seen.energies)
        if seen.energies is not None:
            memory.drift.compare(seen.withheld, seen.energies[1])
        self._tolerances.observe(seen)

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Remember the largest strain, if it wakes cells. Collective."""
        if self._kappa is not None:
            memory, self._noise = self._memory, seen.noise
            start, rigid = memory.window.start, memory.back_off.rigid
            length = seen.t - start
            memory.strokes.look(seen.strains, self._noise, start, seen.t, rigid)
            # A part of what has been seen is meant for no faster motion to come.
            steps = FAST if isinstance(self._tol, Relative) else memory.strokes.time / seen.dt
            memory.bends.look(memory.strokes.rate_of_all, self._noise, steps)
            rested = seen.t - memory.loads.resting_since
            # A load that stands still at a crest does not rest.
            turning = memory.strokes.turning if rested >= HALF * length else 0.0
            energy = self._stiffness * seen.indicator.weights * memory.strokes.swung**2
            energy = np.where(seen.flexible, energy, 0.0)
            memory.drift.stiffening = seen.stiffening or memory.drift.stiffening
            memory.drift.window_ends(energy, rigid, memory.strokes.last, turning, length, rested)
            largest = self._comm.allreduce(float(self.tol.max(initial=0.0)), op=MPI.MAX)
            memory.drift.limit = HALF * self._kappa * largest
            # A slow motion goes farther than its rates tell.
            moved, may = memory.bends.swing(), memory.bends.limits(np.array([largest]))
            memory.drift.driven = inf
            if may is not None and moved > 0:
                memory.drift.driven = HALF * self._kappa * memory.strokes.last * may[0] / moved

    def told(self) -> str:
        """Nothing that the user has not set."""
        return ""

    def waking(self, strained: Strained, free: Bools) -> Waking:
        """Each cell that would strain too fast wakes; what has withheld too much, whole."""
        much = strained.sum > 1
        bent = False if strained.bend is None else strained.bend > 1
        return Waking(free & (much | (strained.rate > 1)), free & (much | bent))

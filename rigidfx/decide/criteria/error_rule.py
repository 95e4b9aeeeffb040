"""The rule of `StrainRate` where the error motion is known: one tolerance, and κ times that.

Cells are quiet up to a strain rate in u + e, their tolerance. A cell that e strains at more than
κ times its tolerance wakes, and so do all cells above theirs in its part and in parts that joints
link with it.
"""

from __future__ import annotations

from math import inf
from typing import ClassVar, Literal

import numpy as np
from mpi4py import MPI

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array, Bools
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.criteria.tolerances import Tolerances
from rigidfx.decide.criteria.window_length import window_length
from rigidfx.decide.memory.memory import Memory
from rigidfx.error.strained import Limits, Strained
from rigidfx.scene.timeline import Timeline

__all__ = ["ErrorRule"]


class ErrorRule:
    """See the module."""

    remembered: ClassVar[Remembered] = same("_noise")

    def __init__(
        self,
        timeline: Timeline,
        memory: Memory,
        tolerances: Tolerances,
        window: float | Literal["auto"],
        kappa: float,
    ) -> None:
        """Nothing has been observed.

        Args:
            timeline: Where steps end.
            memory: Memory of the policy.
            tolerances: Of each owned cell.
            window: Length of a window [s].
            kappa: Factor of waking.
        """
        self._timeline, self._memory, self._tolerances = timeline, memory, tolerances
        self._window, self._kappa = window, kappa
        self._noise = 0.0  # strain rate that rounding may leave, in the last step [1/s]

    @property
    def tol(self) -> Array:
        """Tolerance of each owned cell now [1/s]."""
        return self._tolerances.now()

    def limits(self) -> Limits:
        """Strain rates that wake cells."""
        rates = self._kappa * np.maximum(self.tol, self._noise)
        length = self.length()
        return Limits(rates, length if np.isfinite(length) else inf)

    @property
    def rigidity(self) -> None:
        """Not estimated: tolerances are the user's."""
        return None

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known. Collective."""
        return window_length(self._window, self._memory)

    def observe(self, seen: Observation) -> None:
        """Remember the largest strain rate, where tolerances are parts of it. Collective."""
        self._noise = seen.noise
        self._tolerances.observe(seen)

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Nothing more is asked of a window than its rates."""

    def told(self) -> str:
        """Nothing that the user has not set."""
        return ""

    def waking(self, strained: Strained, free: Bools) -> Bools:
        """Cells above their tolerance, in parts linked with one above κ times its own. Collective.

        If only the latter woke, a second release would soon follow the first.
        """
        comm, group = self._tolerances.comm, self._tolerances.group
        above = np.zeros(comm.allreduce(int(group.max(initial=-1)) + 1, op=MPI.MAX), dtype=bool)
        above[group[free & (strained.rate > 1)]] = True
        comm.Allreduce(MPI.IN_PLACE, above, op=MPI.LOR)
        return free & (strained.rate * self._kappa > 1) & above[group]

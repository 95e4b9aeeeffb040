"""How often strains of e are measured: in one of four steps while they are small."""

from __future__ import annotations

from collections import deque
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same
from rigidfx.error.error_motion import LOOKS
from rigidfx.error.forces.body_forces import BodyForces
from rigidfx.error.forces.parts import Parts

__all__ = ["Pace"]

Array = npt.NDArray[np.float64]

CALM = 0.5  # part of the rate that wakes cells, below which a look in several steps is enough
ALARM = 2.0  # times the largest recent change of ρ in a step: a force that is new is looked at
RECENT = 8  # steps whose changes count


class Pace:
    """Says whether bodies are far from waking.

    Attributes:
        ratio: Largest strain rate of e in rigid cells at the last look, over the rate that wakes.
    """

    remembered: ClassVar[Remembered] = same("_alarmed", "_waited", "ratio")

    def __init__(self, forces: BodyForces) -> None:
        """Nothing has been looked at.

        Args:
            forces: Knows ρ.
        """
        self._forces = forces
        self._last: tuple[Parts, Array] | None = None
        self._changes: deque[float] = deque(maxlen=RECENT)
        self._alarmed, self._waited = True, 0
        self.ratio = 1.0

    @property
    def calm(self) -> bool:
        """Whether e strains rigid cells little, and no force is new."""
        return self.ratio <= CALM and not self._alarmed

    def refresh(self) -> None:
        """Forget ρ of the step before."""
        self._last = None
        self._changes.clear()

    def follow(self) -> None:
        """Compare ρ of an attempt with that of the step before. Collective."""
        before, self._last = self._last, self._forces.borne
        self._alarmed = True
        if self._last is None or before is None or before[0] is not self._last[0]:
            self._changes.clear()
            return
        parts, force = self._last
        change = parts.size(force - before[1])
        self._alarmed = not self._changes or change > ALARM * max(self._changes)
        self._changes.append(change)

    @property
    def looked(self) -> bool:
        """Whether the last step had a look."""
        return self._waited == 0

    def due(self) -> bool:
        """Whether a look is due at this step of e."""
        self._waited = 0 if not self.calm or self._waited + 1 >= LOOKS else self._waited + 1
        return self._waited == 0

"""How often strains of e are measured: in one of four steps while they are small."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_NODES, Remembered, same
from rigidfx.base.types import Array
from rigidfx.error.error_motion import LOOKS
from rigidfx.error.forces.body_forces import BodyForces

__all__ = ["Pace"]


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

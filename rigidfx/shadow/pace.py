"""How often shadows take a step: where they are calm, in long steps.

Two solves per step with the factors of the rigid cells cost more than the rest of a step where most
cells are rigid. So shadows take one step in place of four or sixteen, under the mean force, where
that wakes nothing and misses nothing: what strains cells over what wakes them, even if it comes
nearer twice as fast as it does, stays below a part of that, and rates change so little within the
step that it resolves them. What forces strain grows with their changes, too: a force that changes
by so much more than it did that it might wake cells ends a long step at once. How much changes
strain is told by single steps: the mean force of a long one has nothing of what swings within it.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from rigidfx.base.instants import same_length

__all__ = ["LONG", "LOOKS", "Pace", "Stretch"]

Array = npt.NDArray[np.float64]
Stretch = tuple[Array, float]  # ρ [N] in a time, and the length of that [s]

LONG = 16, 4  # steps that a calm shadow may take as one, the most first
LOOKS = 8  # of which the largest counts: what vibrates is at rest twice in a period
CALM = 0.75, 0.95  # parts of what wakes cells, rates and what adds up, below which both stay
FASTER = 2.0  # times what they have come nearer by in a step: what they may
RESOLVED = 1.0  # times the largest rate by which rates may change in a long step ...
SMALL = 0.1  # ... or part of what wakes cells
LEAST = 1e-3  # part of it that is taken for what is less, as nothing tells nothing ...
FAR = 1e9  # ... and for what is more, or not known
LITTLE = 0.01  # part of a force that its change may be and not count, and ...
TINY = 1e-15  # ... of what wakes cells where it may be any; LEAST of that over what it comes to
ALARMING = 0.5  # part of it that the changes of a force may let expect


class Pace:
    """Collects forces and says when shadows take a step.

    Attributes:
        waiting: Forces on the bodies, and lengths, of steps that shadows have not taken.
        last: Force of the last step; None if there is none.
    """

    def __init__(self) -> None:
        """Nothing is known: the next step is taken at once."""
        self.waiting: list[Stretch] = []
        self.last: Array | None = None
        self._changes: deque[float] = deque([0.0], maxlen=LOOKS)  # largest of a force in a step
        self._largest = 0.0  # that since the last look
        unknown = np.full(2, FAR)  # of rates, and of what adds up
        self._parts: deque[Array] = deque([unknown], maxlen=LOOKS)
        self._nearer: deque[Array] = deque([unknown], maxlen=LOOKS)
        self._turns: deque[float] = deque([FAR], maxlen=LOOKS)
        self._gains: deque[float] = deque([0.0], maxlen=LOOKS)  # of a change, in single steps
        self._long = 1
        self._alarmed = False  # whether the present force has changed too much

    def due(self, force: Array, dt: float, change: float) -> bool:
        """Whether shadows take their steps now.

        Args:
            force: ρ of the present step.
            dt: Its length [s].
            change: Size of its change since the last step, equal on all ranks.
        """
        self._alarmed = self.alarming(change)
        if self._alarmed or len(self.waiting) + 1 >= self._long:
            return True
        return not all(same_length(length, dt) for _, length in self.waiting)

    def alarming(self, change: float) -> bool:
        """Whether a force that changes so much may wake cells."""
        most = max(self._changes)
        rate = max(LEAST, max(self._gains) * most, *(float(rate) for rate, _ in self._parts))
        return change * rate > ALARMING * most

    @property
    def little(self) -> float:
        """Part of its size by which a force may change and be taken for the last one."""
        return LITTLE * max(1.0, LEAST / max(float(np.max(self._parts)), TINY))

    def rest(self, force: Array) -> None:
        """Take note of a step in which no force acted on shadows at rest."""
        self.last = force

    def wait(self, force: Array, dt: float, change: float) -> None:
        """Take note of a step that shadows have not taken."""
        self.waiting.append((force, dt))
        self.last, self._largest = force, max(self._largest, change)

    def taken(self, force: Array, change: float, rate: float, withheld: float) -> None:
        """Take note that shadows have taken all steps.

        Args:
            force: ρ of the last of them.
            change: Size of its change.
            rate: Strain rates over those that wake cells, the largest of all.
            withheld: What adds up over what wakes cells, likewise.
        """
        parts = np.minimum([rate, withheld], FAR)
        # What alarms has come in one step.
        steps = 1 if self._alarmed else len(self.waiting) + 1
        most = np.max(self._parts, axis=0)
        self._nearer.append(np.maximum(parts - most, 0.0) / steps)
        self._turns.append(abs(rate - float(self._parts[-1][0])) / steps)
        self._parts.append(parts)
        self._long = next((long for long in LONG if self._calm(long)), 1)
        self.waiting = []
        self.last = force
        self._changes.append(max(self._largest, change))
        self._largest = 0.0
        if steps == 1 and max(self._changes) > 0:
            self._gains.append(max(rate, LEAST) / max(self._changes))

    def _calm(self, long: int) -> bool:
        """Whether a step of so many wakes nothing, and resolves what shadows do."""
        parts, nearer = np.max(self._parts, axis=0), np.max(self._nearer, axis=0)
        if not (parts + FASTER * long * nearer < CALM).all():
            return False
        return bool(long * max(self._turns) <= max(RESOLVED * parts[0], SMALL))

    def stretches(self, force: Array, dt: float) -> list[Stretch]:
        """Steps that shadows have to take: one long one, if nothing is against it."""
        steps = [*self.waiting, (force, dt)]
        even = len(steps) == self._long and all(same_length(length, dt) for _, length in steps)
        if even and not self._alarmed:
            return [(np.mean([f for f, _ in steps], axis=0), len(steps) * dt)]
        return steps

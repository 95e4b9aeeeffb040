"""How often shadows take a step: where they are calm, in long steps.

Two solves per step with the factors of the rigid cells cost more than the rest of a step where most
cells are rigid. What forces strain grows with their changes: as long as cells strain by much less
than what wakes them, and forces change as they did when that was found, shadows take one step in
place of four, under the mean force. A force that changes by so much more that it might wake cells
ends that at once.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from rigidfx.base.instants import same_length

__all__ = ["LONG", "LOOKS", "Pace", "Stretch"]

Array = npt.NDArray[np.float64]
Stretch = tuple[Array, float]  # ρ [N] in a time, and the length of that [s]

LONG = 4  # steps that a calm shadow takes as one
LOOKS = 8  # of which the largest counts: what vibrates is at rest twice in a period
CALM = 0.25  # part of what wakes cells below which shadows are calm
LEAST = 1e-3  # part of it that is taken for what is less, as nothing tells nothing
ALARMING = 0.5  # part of it that the changes of a force may let expect


class Pace:
    """Collects forces and says when shadows take a step.

    Attributes:
        waiting: Forces on the bodies, and lengths, of steps that shadows have not taken.
    """

    def __init__(self) -> None:
        """Nothing is known: the next step is taken at once."""
        self.waiting: list[Stretch] = []
        self._before: Array | None = None  # last force
        self._usual = self._largest = 0.0  # change of a force per step: until a look, and since
        self._ratios: deque[float] = deque([np.inf], maxlen=LOOKS)
        self._alarmed = False  # whether the present force has changed too much

    def due(self, force: Array, dt: float, change: float) -> bool:
        """Whether shadows take their steps now.

        Args:
            force: ρ of the present step.
            dt: Its length [s].
            change: Size of its change since the last step, equal on all ranks.
        """
        ratio, self._alarmed = max(self._ratios), self.alarming(change)
        if self._alarmed or ratio >= CALM or len(self.waiting) + 1 >= LONG:
            return True
        return not all(same_length(length, dt) for _, length in self.waiting)

    def alarming(self, change: float) -> bool:
        """Whether a force that changes so much may wake cells."""
        return change * max(*self._ratios, LEAST) > ALARMING * self._usual

    @property
    def last(self) -> Array | None:
        """The force of the last step; None if there is none."""
        return self._before

    def before(self, force: Array) -> Array:
        """The force of the last step; the present one if there is none."""
        return force if self._before is None else self._before

    def wait(self, force: Array, dt: float, change: float) -> None:
        """Take note of a step that shadows have not taken."""
        self.waiting.append((force, dt))
        self._before, self._largest = force, max(self._largest, change)

    def taken(self, force: Array, change: float, ratio: float) -> None:
        """Take note that shadows have taken all steps.

        Args:
            force: ρ of the last of them.
            change: Size of its change.
            ratio: What strains cells over what wakes them, the largest of all.
        """
        self.waiting = []
        self._before = force
        self._ratios.append(ratio)
        self._usual, self._largest = max(self._largest, change), 0.0

    def stretches(self, force: Array, dt: float) -> list[Stretch]:
        """Steps that shadows have to take: one long one, if nothing is against it."""
        steps = [*self.waiting, (force, dt)]
        even = len(steps) == LONG and all(same_length(length, dt) for _, length in steps)
        if even and not self._alarmed:
            return [(np.mean([f for f, _ in steps], axis=0), LONG * dt)]
        return steps

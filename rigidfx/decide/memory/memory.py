"""All that a policy remembers: the window of observation, and changes of contacts, among others.

The force of a contact is known after a step has been solved. If it differs from its value at the
last freeze by more than a given fraction of its largest value so far, bodies are released and the
step is solved again, so that the struck part is flexible in the step of the impact. A first touch
is such a change; rattling with smaller forces is none. If the forces of a contact add up to zero,
as those of a surface against itself, the sum of their magnitudes counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_CELLS, PART, Remembered, same
from rigidfx.base.types import Array, Indices
from rigidfx.decide.memory.back_off import BackOff
from rigidfx.decide.memory.load_changes import LoadChanges
from rigidfx.decide.memory.signals import Signals
from rigidfx.effects import Touch

__all__ = ["ContactChanges", "Memory", "Window"]

NOTHING = np.zeros(4)


class ContactChanges:
    """Watches the forces of contacts."""

    remembered: ClassVar[Remembered] = same("_last", "_reference", "_largest")

    def __init__(self, fraction: float) -> None:
        """Begin without any.

        Args:
            fraction: Change that counts, relative to the largest force of that contact so far.
        """
        self._fraction = fraction
        self._last: dict[str, Array] = {}
        self._reference: dict[str, Array] = {}
        self._largest: dict[str, float] = {}

    @property
    def watched(self) -> bool:
        """Whether any change counts."""
        return bool(np.isfinite(self._fraction))

    def changed(self, touches: Mapping[str, Touch]) -> list[str]:
        """Titles of contacts that differ too much in a step that has been solved.

        Args:
            touches: Effects of contacts in it.
        """
        changes = {k: _of(touch) - self._reference.get(k, NOTHING) for k, touch in touches.items()}
        least = {k: self._fraction * self._largest.get(k, 0.0) for k in changes}
        return [k for k, change in changes.items() if _size(change) > least[k]]

    def follow(self, touches: Mapping[str, Touch]) -> None:
        """Record a step that was accepted."""
        self._last = {title: _of(touch) for title, touch in touches.items()}
        for title, forces in self._last.items():
            self._largest[title] = max(_size(forces), self._largest.get(title, 0.0))

    def remember(self) -> None:
        """Record the last forces as those of the present bodies."""
        self._reference = dict(self._last)


def _of(touch: Touch) -> Array:
    """The force of a contact, and the sum of the sizes of its nodal forces, shape (4,) [N]."""
    return np.array([*touch.force, touch.pressing])


def _size(forces: Array) -> float:
    """Size of either, or of its change, whichever is larger [N]."""
    return max(float(np.linalg.norm(forces[:3])), abs(float(forces[3])))


class Window:
    """Largest strain rate of each cell since the window began.

    Attributes:
        start: Time at which it began [s].
        worst: Per owned cell [1/s].
        steps: Number of steps observed.
        whole: Whether a cell has been flexible in all of them.
        over: Whether it has its length.
    """

    remembered: ClassVar[Remembered] = same("start", "steps", "over") | {
        "worst": ON_CELLS,
        "whole": ON_CELLS,
    }

    def __init__(self, cells: int, start: float) -> None:
        """A window that begins.

        Args:
            cells: Number of owned cells.
            start: Time [s].
        """
        self.start, self.worst, self.steps = start, np.zeros(cells), 0
        self.whole = np.ones(cells, dtype=bool)
        self.over = False

    def add(self, cells: Indices, rates: Array) -> None:
        """Observe a step.

        Args:
            cells: Flexible owned cells.
            rates: Their strain rates [1/s].
        """
        self.worst[cells] = np.maximum(self.worst[cells], rates)
        self.steps += 1


@dataclass
class Memory:
    """All that a policy remembers.

    Attributes:
        window: The window of observation.
        signals: The motion and the loads since the last change.
        back_off: How long cells have to wait.
        loads: The loads of the present bodies, and the largest so far.
        contacts: The same of contacts.
        next_number: First number that no body has had.
        said: Kinds of warnings that were given.
        largest: Largest strain rate of any cell so far, if tolerances are relative to it [1/s].
    """

    remembered: ClassVar[Remembered] = same("next_number", "said", "largest") | dict.fromkeys(
        ("window", "signals", "back_off", "loads", "contacts"), PART
    )

    window: Window
    signals: Signals
    back_off: BackOff
    loads: LoadChanges
    contacts: ContactChanges
    next_number: int
    said: set[str] = field(default_factory=set)
    largest: float = 0.0

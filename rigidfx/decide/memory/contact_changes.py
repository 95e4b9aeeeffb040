"""Contacts that close or change: changes of a load that no function of time contains.

The force of a contact is known after a step has been solved. If it differs from its value at the
last freeze by more than a given fraction of its largest value so far, bodies are released and the
step is solved again, so that the struck part is flexible in the step of the impact. A first touch
is such a change; rattling with smaller forces is none. If the forces of a contact add up to zero,
as those of a surface against itself, the sum of their magnitudes counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Touch

__all__ = ["ContactChanges"]

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

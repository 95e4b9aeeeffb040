"""The laws of points whose forces depend on the motion: torques, springs, masses, cables."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.on_face import PointLaw

__all__ = ["Points"]

Array = npt.NDArray[np.float64]


class Points:
    """Laws of remote points; their averages come after those of the joints.

    Attributes:
        averages: The averages of all of them.
        kinds: Names of the kinds of effects.
        rounding: Size of a force that the machine precision is to be multiplied with [N].
    """

    def __init__(self, laws: Sequence[PointLaw], first: int) -> None:
        """Number their averages.

        Args:
            laws: The laws.
            first: Number of the first average.
        """
        self._laws = tuple(laws)
        self.averages: list[Vector] = [a for law in laws for a in law.averages]
        self.kinds = tuple(dict.fromkeys(law.kind for law in laws))
        self.rounding = sum(law.rounding for law in laws)
        ends = first + np.cumsum([0, *(len(law.averages) for law in laws)])
        self._at = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        none: Array = np.zeros((int(ends[-1]), 3))
        self._start = self._moved = none

    def __len__(self) -> int:
        """How many laws there are."""
        return len(self._laws)

    def set_time(self, t: float, dt: float) -> None:
        """See `PointLaw`."""
        for law in self._laws:
            law.set_time(t, dt)

    def look(self, start: Array, moved: Array) -> None:
        """See an iterate: averages of joints and points at the start, and their increments."""
        self._start, self._moved = start, moved

    def add_to(self, forces: Array) -> None:
        """Add resistances to forces on all averages, shape (averages, 3) [N]."""
        for law, at in zip(self._laws, self._at, strict=True):
            forces[at] += law.resistance(self._start[at], self._moved[at])

    def stiffness(self) -> csr_array:
        """Their derivatives by all averages, shape (3 · averages,) * 2 [N/m]."""
        size = self._start.size
        rows, columns, values = list[Array](), list[Array](), list[Array]()
        for law, at in zip(self._laws, self._at, strict=True):
            block = law.stiffness(self._start[at], self._moved[at])
            n = block.shape[0] * 3
            numbers = 3 * at.start + np.arange(n)
            rows.append(np.repeat(numbers, n))
            columns.append(np.tile(numbers, n))
            values.append(block.ravel())
        value, row, column = (np.concatenate(a) for a in (values, rows, columns))
        return csr_array((value, (row, column)), shape=(size, size))

    def told(self) -> dict[str, Any]:
        """Reports of the laws that have a title, of the last step, by title."""
        pairs = zip(self._laws, self._at, strict=True)
        own = ((law, self._start[at], self._moved[at]) for law, at in pairs if law.title)
        return {law.title: law.told(start, moved) for law, start, moved in own}

    def work(self) -> tuple[float, dict[str, float]]:
        """Work of loads in the step, and loss by dampers by their kind [J]."""
        done, taken = 0.0, dict[str, float]()
        for law, at in zip(self._laws, self._at, strict=True):
            start, moved = self._start[at], self._moved[at]
            done += law.work(start, moved)
            if lost := law.taken(start, moved):
                taken[law.kind] = taken.get(law.kind, 0.0) + lost
        return done, taken

    def stored(self, p: Array) -> float:
        """Energy of springs where all averages are at p [J]."""
        pairs = zip(self._laws, self._at, strict=True)
        return float(sum(law.stored(p[at]) for law, at in pairs))

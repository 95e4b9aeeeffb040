"""Supports that follow a user's path: is a velocity given beside it its derivative?

Neither is known but at instants that are asked for, and so is not the time in which they change. A
difference quotient tells something where rounding leaves it two digits. It is compared with
the largest velocity near by, not with the one at the same instant, which may vanish there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rigidfx.base.types import Array

__all__ = ["PathAndVelocity"]


AT_START = 1e-2  # of the largest velocity: nodes get the velocity of the start
LATER = 5e-2  # of it: a path may be a polygon and the velocity that of the curve it stands for
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements
SPANS = 10.0 ** -np.arange(1, 10)  # s
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples hit no period and no round number
EVENLY, EARLY = 17, 7  # instants spread over a run, and ever closer to its start
FINER, LEVELS = 4.0, 6  # spans of a central difference


@dataclass(frozen=True)
class PathAndVelocity:
    """A path and a velocity as functions of time, and the components that count.

    Attributes:
        path: Function t → displacement, shape (3,) [m].
        velocity: Function t → velocity, shape (3,) [m/s].
        axes: The components that are compared.
        unit: That of the path, for messages.
    """

    path: Callable[[float], Array]
    velocity: Callable[[float], Array]
    axes: tuple[int, ...]
    unit: str = "m"

    def contradiction_at(self, t: float, end: float) -> str:
        """Contradiction of the velocity and the path just after t, before an end [s]; "" if none.

        It is right if a one-sided quotient over any of several spans comes near it.
        """
        v, u = self._of(self.velocity, t), self._of(self.path, t)
        found = []
        for h in np.minimum(SPANS, 0.5 * (end - t)):
            u1, u2 = self._of(self.path, t + h), self._of(self.path, t + 2 * h)
            q = (4 * u1 - 3 * u - u2) / (2 * h)
            found.append((q, _noise(h, t, u, u1)))
        quotients, noise = np.array([q for q, _ in found]), np.array([n for _, n in found])
        quotients = np.where(np.isfinite(quotients), quotients, np.nan)
        known = np.isfinite(quotients).all(axis=1)
        sizes = np.where(known, np.nan_to_num(np.abs(quotients)).max(axis=1) - noise, 0.0)
        tolerance = AT_START * max(float(np.abs(v).max()), float(sizes.max()))
        told = quotients[known & (noise <= tolerance)]
        off = np.abs(told - v).max(axis=1)
        if not len(told) or (off <= tolerance).any() or not np.isfinite(v).all():
            return ""
        apart = np.abs(np.diff(told, axis=0)).max(axis=1)
        return self._words(t, v, told[int(np.argmin(apart)) if len(apart) else 0])

    def contradiction_within(self, start: float, end: float, kinks: Sequence[float]) -> str:
        """Contradiction at several instants between start and end [s]; "" if none.

        No quotient straddles a kink. At one instant alone an unnamed kink may be the cause, so that
        takes two of them.
        """
        shares = np.append(
            (0.5 + GOLDEN * np.arange(EVENLY)) % 1, GOLDEN * 10.0 ** -np.arange(EARLY)
        )
        instants = np.sort(start + (end - start) * shares)
        ends = np.array([start, *sorted(k for k in kinks if start < k < end), end])
        after = np.searchsorted(ends, instants, side="right")
        room = 0.5 * np.minimum(instants - ends[after - 1], ends[after] - instants)
        u = np.array([self._of(self.path, t) for t in instants])
        v = np.array([self._of(self.velocity, t) for t in instants])
        known = np.isfinite(u).all(axis=1) & np.isfinite(v).all(axis=1) & (room > 0)
        if not known.any():
            return ""
        instants, room, u, v = instants[known], room[known], u[known], v[known]
        fastest = max(map(self._fastest, instants, room, u))
        if fastest > 0:  # a span short for the path, however fast it goes there and back
            way = max(float(np.ptp(u, axis=0).max()), float(np.finfo(float).tiny))
            room = np.minimum(room, max(way / fastest / FINER, 1e-9 * float(room.max())))
        scale = max(fastest, float(np.abs(v).max()))
        wrong = []
        for t, most, here, given in zip(instants, room, u, v, strict=True):
            q, error = self._central(t, most, here)
            off = float(np.abs(q - given).max())
            if off > LATER * scale + error:
                wrong.append((off, self._words(t, given, q)))
        return max(wrong)[1] if len(wrong) > 1 else ""

    def _fastest(self, t: float, room: float, u: Array) -> float:
        """Largest quotient over any span that is more than rounding [m/s]."""
        sizes = [0.0]
        for h in room * SPANS:
            u1 = self._of(self.path, t + h)
            size = float(np.abs(u1 - u).max()) / h - _noise(h, t, u, u1)
            sizes.append(size if np.isfinite(size) else 0.0)
        return max(sizes)

    def _central(self, t: float, most: float, u: Array) -> tuple[Array, float]:
        """The central quotient that is known best, and its uncertainty [m/s]."""
        found: list[tuple[Array, float]] = []
        for k in range(LEVELS):
            h = most / FINER**k
            gained = self._of(self.path, t + h) - self._of(self.path, t - h)
            q: Array = np.asarray(gained / (2 * h))
            found.append((q, _noise(h, t, u, q * h)))
        best, error = found[0][0], np.inf
        for (q, _), (finer, noise) in pairwise(found):
            off = float(np.abs(finer - q).max()) + noise
            if off < error:  # not so where one is not finite
                best, error = finer, off
        return best, error

    def _of(self, function: Callable[[float], Array], t: float) -> Array:
        """The components that count; NaN where a function is not defined: a step would tell."""
        try:
            value = function(float(t))
        except Exception:  # whatever a user's function may raise
            value = np.empty(0)
        return (
            value[list(self.axes)] if np.shape(value) == (3,) else np.full(len(self.axes), np.nan)
        )

    def _words(self, t: float, v: Array, q: Array) -> str:
        names = "".join("xyz"[axis] for axis in self.axes)
        along = "" if names == "xyz" else f" along {', '.join(names)}"
        unit = f"{self.unit}/s"
        return f"at t = {t:g} s its velocity is {v} {unit}{along}, and its path moves by {q} {unit}"


def _noise(h: float, t: float, u: Array, further: Array) -> float:
    """Rounding of displacements and of times in a quotient over a span h [m/s]."""
    gained = float(np.abs(further - u).max())
    return ROUNDING * (float(np.abs(u).max()) + gained * (1 + abs(t) / h)) / h

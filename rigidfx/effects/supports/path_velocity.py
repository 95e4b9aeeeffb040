"""Supports that follow a user's path: is a velocity given beside it its derivative?

Neither is known but at instants that are asked for, and so is not the time in which they change.
One-sided difference quotients over several spans are compared with the velocity, as far as rounding
leaves them two digits, and over no span in which the path goes there and back. The velocity is
right where one of them comes near it. The measure is the largest velocity near by, not the one at
the same instant, which may vanish there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rigidfx.base.types import Array

__all__ = ["PathAndVelocity"]


AT_START = 1e-2  # of the largest velocity: nodes get the velocity of the start
LATER = 5e-2  # of it: a path may be a polygon and the velocity that of the curve it stands for
ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements
SPANS = 10.0 ** -np.arange(1, 10)  # s
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples hit no period and no round number
EVENLY, EARLY = 17, 7  # instants spread over a run, and ever closer to its start


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
        """Contradiction of velocity and path just after t, before an end [s]; "" if none."""
        wrong = self._wrong(np.array([t]), np.array([end]), AT_START)
        return wrong[0][1] if wrong else ""

    def contradiction_within(self, start: float, end: float, kinks: Sequence[float]) -> str:
        """Contradiction at several instants between start and end [s]; "" if none.

        No quotient straddles a kink. At one instant alone an unnamed kink may be the cause, so that
        takes two of them.
        """
        shares = np.append(
            (0.5 + GOLDEN * np.arange(EVENLY)) % 1, GOLDEN * 10.0 ** -np.arange(EARLY)
        )
        instants = start + (end - start) * shares
        ends = np.array([*sorted(k for k in kinks if start < k < end), end])
        after = np.minimum(np.searchsorted(ends, instants, side="right"), len(ends) - 1)
        wrong = self._wrong(instants, ends[after], LATER)
        return max(wrong)[1] if len(wrong) > 1 else ""

    def _wrong(self, t: Array, ends: Array, share: float) -> list[tuple[float, str]]:
        """Instants at which no quotient before their ends is near the velocity.

        Returns:
            By how much, of each that is off by more than a share of the largest velocity [m/s], and
            that in words.
        """
        h = np.minimum(SPANS, 0.5 * (ends - t)[:, None])
        at = t[:, None]
        v, u = self._of(self.velocity, at), self._of(self.path, at)
        u1, u2 = self._of(self.path, at + h), self._of(self.path, at + 2 * h)
        quotients = (4 * u1 - 3 * u - u2) / (2 * h[..., None])
        gained = np.abs(u1 - u).max(axis=2)
        noise = ROUNDING * (np.abs(u).max(axis=2) + gained * (1 + np.abs(at) / h)) / h
        speeds, way = np.nan_to_num(gained / h - noise), np.nan_to_num(gained)
        fastest = max(float(speeds.max()), 0.0)
        tolerance = share * max(fastest, float(np.nan_to_num(np.abs(v)).max()))
        known = (noise <= tolerance) & (h * fastest <= max(float(way.max()), float(h.min())))
        off = np.abs(quotients - v).max(axis=2)
        off = np.where(known & np.isfinite(off), off, np.inf)
        best, rows = off.argmin(axis=1), np.arange(len(t))
        wrong = np.flatnonzero((off[rows, best] > tolerance) & np.isfinite(off[rows, best]))
        return [
            (float(off[k, best[k]]), self._words(t[k], v[k, 0], quotients[k, best[k]]))
            for k in wrong
        ]

    def _of(self, function: Callable[[float], Array], t: Array) -> Array:
        """The components that count, shape (*t, components); NaN where a function is not defined.

        A step would tell of that.
        """

        def value(t: float) -> Array:
            try:
                found = function(t)
            except Exception:  # whatever a user's function may raise
                found = np.empty(0)
            return found[list(self.axes)] if np.shape(found) == (3,) else none

        none = np.full(len(self.axes), np.nan)
        return np.array([value(float(each)) for each in t.flat]).reshape(*t.shape, -1)

    def _words(self, t: float, v: Array, q: Array) -> str:
        names = "".join("xyz"[axis] for axis in self.axes)
        along = "" if names == "xyz" else f" along {', '.join(names)}"
        unit = f"{self.unit}/s"
        return f"at t = {t:g} s its velocity is {v} {unit}{along}, and its path moves by {q} {unit}"

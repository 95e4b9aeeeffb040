"""A user's path and a velocity given beside it: is that the derivative?

Both are known only at instants that are asked for. One-sided difference quotients over several
spans are compared with the velocity, as far as rounding leaves them two digits, and over no span in
which the path goes there and back. The velocity is right where one of them comes near it. The
measure is the largest velocity near by, as the one at the same instant may vanish.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.types import Array

ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a difference of displacements
SPANS = 10.0 ** -np.arange(1, 10)  # s


@dataclass(frozen=True)
class PathAndVelocity:
    """A path and a velocity as functions of time, and the components that count."""

    path: Callable[[float], Array]  # t → displacement, shape (3,) [m]
    velocity: Callable[[float], Array]  # t → velocity, shape (3,) [m/s]
    axes: tuple[int, ...]
    unit: str = "m"  # that of the path, for messages

    def contradictions(self, t: Array, ends: Array, share: float) -> list[tuple[float, str]]:
        """By how much quotients from instants to before their ends are off the velocity, in words.

        Only instants count where all are off by more than a share of the largest velocity [m/s].
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
        """The components that count, shape (*t, components); NaN where a function has no value."""

        def value(t: float) -> Array:
            try:
                found = function(t)
            except Exception:  # whatever a user's function may raise; a step would tell of it
                found = np.empty(0)
            return found[list(self.axes)] if np.shape(found) == (3,) else none

        none = np.full(len(self.axes), np.nan)
        return np.array([value(float(each)) for each in t.flat]).reshape(*t.shape, -1)

    def _words(self, t: float, v: Array, q: Array) -> str:
        names = "".join("xyz"[axis] for axis in self.axes)
        along = "" if names == "xyz" else f" along {', '.join(names)}"
        unit = f"{self.unit}/s"
        return f"at t = {t:g} s its velocity is {v} {unit}{along}, and its path moves by {q} {unit}"


def slope_after(path: Callable[[float], Any], t: float, dt: float) -> Any:
    """One-sided difference quotient of second order just after t [s], by a thousandth of dt [s]."""
    h = 1e-3 * dt
    u0, u1, u2 = (path(t + k * h) for k in range(3))
    return (4 * u1 - 3 * u0 - u2) / (2 * h)

"""The penalty U(g) = ½ k g₋² of a gap g, and its secant [U] = (U₁ - U₀)/(g₁ - g₀).

A force -[U] in a variable whose increment is exact removes exactly the gain of U from the motion,
for any step (T. A. Laursen and V. Chawla, IJNME 40 (1997) 863). If one end is open, the denominator
exceeds the penetration at the other end, so 0/0 cannot occur.
"""

from __future__ import annotations

import numpy as np

from rigidfx.base.types import Array

__all__ = ["STALE", "outdated", "secant", "stored"]


STALE = 0.05  # change of a derivative, which is k/2 at most, by k


def stored(k: Array, g: Array) -> Array:
    """U of gaps g [m] with stiffnesses k [N/m], shape (n,) [J]."""
    return np.asarray(0.5 * k * np.minimum(g, 0.0) ** 2)


def secant(k: Array, g0: Array, g1: Array) -> tuple[Array, Array]:
    """[U], and its derivative by g₁.

    Args:
        k: Stiffnesses, shape (n,) [N/m].
        g0: Gaps at the start of a step, shape (n,) [m].
        g1: Gaps at its end, likewise.

    Returns:
        Shapes (n,) [N] and (n,) [N/m]; the first is never positive, the second never negative.
    """
    closes, opens = (g0 >= 0) & (g1 < 0), (g0 < 0) & (g1 >= 0)
    apart = np.where(closes | opens, g1 - g0, 1.0)
    share0, share1 = g0 / apart, g1 / apart
    half = np.where((g0 < 0) & (g1 < 0), 0.5 * k, 0.0)
    value, slope = half * (g0 + g1), half
    value = np.where(closes, 0.5 * k * g1 * share1, value)
    slope = np.where(closes, 0.5 * k * share1 * (2 - share1), slope)
    value = np.where(opens, -0.5 * k * g0 * share0, value)
    slope = np.where(opens, 0.5 * k * share0**2, slope)
    return value, slope


def outdated(k: Array, then: Array, now: Array) -> bool:
    """Whether gaps have closed or opened so far that a tangent does not fit any more.

    Args:
        k: Stiffnesses, shape (n,) [N/m].
        then: Derivatives of [U] in the tangent, shape (n,) [N/m].
        now: Derivatives of [U] at the last iterate, likewise.
    """
    return bool((np.abs(now - then) > STALE * np.maximum(k, now)).any())

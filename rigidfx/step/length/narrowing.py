"""Where a function of time is least smooth, by halving intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Onset", "narrowed"]

Array = npt.NDArray[np.float64]

HALVINGS = 14
SMOOTH = 1.5  # powers of an interval's width with which second differences fall: 2 are smooth ...
SHARP = 0.5  # ... 1 is a kink, and 0 a jump
SCATTER = 2.0  # of them, as a kink lies in the middle of an interval or at its border


@dataclass(frozen=True)
class Onset:
    """An instant at which a load is not smooth.

    Attributes:
        t: Time [s]; just after a jump.
        jumps: Whether the load jumps there, in place of bending.
        by: Its jump, in its shape; None if it bends.
        led: Whether it is the velocity of a support's path that jumps.
    """

    t: float
    jumps: bool
    by: Array | None = None
    led: bool = False


def narrowed(q: Callable[[float], Array], times: Array, values: list[Array]) -> Onset | None:
    """Where a function is least smooth; None if it is smooth there.

    Args:
        q: The function of time.
        times: Some times, evenly apart, shape (5,) [s].
        values: Its values there, each of the same shape.
    """
    first = bend = 0.0
    for halvings in range(HALVINGS + 1):
        bends = [
            float(np.linalg.norm(values[k - 1] - 2 * values[k] + values[k + 1])) for k in (1, 2, 3)
        ]
        k = int(np.argmax(bends)) + 1
        bend, first = bends[k - 1], first or bends[k - 1]
        if SCATTER * bend <= first * 2.0 ** (-SMOOTH * halvings):
            return None
        (a, b, c), (qa, qb, qc) = times[k - 1 : k + 2], values[k - 1 : k + 2]
        times = np.array([a, (a + b) / 2, b, (b + c) / 2, c])
        values = [qa, np.asarray(q(float(times[1]))), qb, np.asarray(q(float(times[3]))), qc]
    if bend <= first * 2.0 ** (-SHARP * HALVINGS):
        return Onset(float(b), jumps=False)
    later = np.linalg.norm(qc - qb) > np.linalg.norm(qb - qa)
    return Onset(float(c if later else b), jumps=True, by=np.asarray(qc - qa))

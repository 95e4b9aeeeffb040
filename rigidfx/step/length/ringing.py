"""What rings after a change of bodies: a vibration of amplitude A errs by 2 A, and no more.

Cells that wake spring into the shape that their forces give them, and ring about it at frequencies
of their own. Most of that is no motion of the structure, but what rigidity has put it off by, and
has an account of its own; however long a step is, it cannot err by more than to be in the opposite
phase. Followed as closely as what moves far, it would have Δt go down to a part of its period: a
local error grows with ω³A, and tells nothing of A.

Of accelerations a of evenly long steps the second differences are d = -q a for a vibration, with
q = 4 sin²(θ/2) and θ its phase in a step. By the midpoint rule ω² = q/(1 - q/4)/Δt², and a = -ω² u
in the middle of a step, where a vibration has cos(θ/2) of its amplitude at the ends, so that d and
its own second differences tell q and

    A = |a|/(ω² cos(θ/2)) = |d| Δt² sqrt(1 - q/4)/q²

of the fastest that there is. What is slower is in binomial means of the accelerations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.base.instants import same_length

__all__ = ["Ringing"]

Array = npt.NDArray[np.float64]

STEPS = 8  # of one length, by which frequencies are told apart
SMOOTH = np.array([1, 4, 6, 4, 1]) / 16  # of accelerations: cos⁴(θ/2) is left of a vibration ...
LOW_PASS = np.array([-1, -1, 1, 1]) / 4  # ... and cos² of that of differences, ¼ ½ ¼ of three
OPPOSITE = 2.0  # times its amplitude is what a vibration is off by at most
LEAST = 1e-6  # of q: what is slower is no ringing


@dataclass(frozen=True)
class _Known:
    """What is known after a step.

    Attributes:
        dt: Length of the last steps [s].
        a: Accelerations in these, shape (points, 3) each [m/s²].
        small: Whether what rings errs by little; True while nobody can tell.
    """

    dt: float = 0.0
    a: tuple[Array, ...] = ()
    small: bool = True


class Ringing:
    """Tells what rings, and what moves slowly, since bodies have changed.

    Attributes:
        most: What it errs by at most, of the steps that were accepted [m].
    """

    def __init__(self) -> None:
        """Nothing has changed."""
        self.most = self._next_most = 0.0
        self._now = self._next = _Known()

    def begin(self) -> None:
        """Bodies have changed."""
        self._now = self._next = _Known()

    def look(self, a: Array, dt: float, error: float, little: float) -> float:
        """Error of a step that has been solved [m]; NaN while that of its slow motion is unknown.

        Args:
            a: Accelerations in it, shape (points, 3) [m/s²].
            dt: Its length [s].
            error: What it errs by if all that moves is followed [m].
            little: What may be left out of account, if there is no more of it ever [m].
        """
        now = self._now
        before = now.a if same_length(now.dt, dt) else ()
        known, self._next_most = (*before, a)[-STEPS:], self.most
        self._next = _Known(dt, known, now.small)
        if len(known) < STEPS:
            return float("nan") if now.small else error
        slow, most = _apart(np.array(known), dt)
        small = most <= little and slow < error
        self._next = _Known(dt, known, small)
        if not small:
            return error
        self._next_most = max(self.most, most)
        return slow

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._now, self.most = self._next, self._next_most


def _apart(a: Array, dt: float) -> tuple[float, float]:
    """Local error of the slow motion, and bound of that of what rings, the largest of all [m].

    Args:
        a: Accelerations, shape (steps, points, 3) [m/s²].
        dt: Length of the steps [s].
    """
    d = np.diff(a, 2, axis=0)
    size, next_size = (_root_mean_square(x) for x in (d[1:-1], np.diff(d, 2, axis=0)))
    q = np.divide(next_size, size, out=np.full_like(size, LEAST), where=size > 0)
    q = np.clip(q, LEAST, 4.0)
    amplitude = np.sqrt(2) * size * dt**2 * np.sqrt(1 - q / 4) / q**2
    smooth = sum(w * a[k : len(a) - len(SMOOTH) + 1 + k] for k, w in enumerate(SMOOTH))
    jerk = np.einsum("k,kpi->pi", LOW_PASS, smooth) / dt
    slow = dt**3 / 12 * np.linalg.norm(jerk, axis=1)
    return float(slow.max()), OPPOSITE * float(amplitude.max())


def _root_mean_square(x: Array) -> Array:
    """Of vectors at some times, shape (times, points, 3), for each point."""
    return np.asarray(np.sqrt(np.einsum("kpi,kpi->p", x, x) / len(x)))

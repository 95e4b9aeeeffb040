"""Error of time integration in a step, from the velocities at its ends.

The local error of the midpoint rule is Δt³/12 times the jerk. With a = (v₁ - v₀)/Δt, which belongs
to the middle of a step, and the divided differences j = Δa/Δt of two steps,

    ĵ = ¼ j_{n-2} + ½ j_{n-1} + ¼ j_n ,    â = ⅛ (a_{n-3} + 3 a_{n-2} + 3 a_{n-1} + a_n) .

These means remove a change of sign from step to step: a vibration that steps do not resolve has
it, and it is no error of the resolved motion. While there are fewer differences, means of fewer
replace these.

The jerk of a vibration is zero twice a period, while the error of its phase grows. So the error is
the root mean square over a period: if the jerk is ĵ now, it is ω â a quarter of a period away, and

    d = Δt³/12 sqrt(½ (|ĵ|² + ω² |â|²)) ,    ω² = ∫ Σ |ĵ|² dt / ∫ Σ |â|² dt ,

with sums over all points and integrals over the last 3/ω, about half a period. Errors of one
vibration add up to √2 of Σ d, those of a steady rotation to Σ d.
"""

from __future__ import annotations

from functools import cache
from math import comb, exp, nan, sqrt
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array

DIFFERENCES = 3  # that ĵ is the mean of: two let a ringing from step to step through
TURN = 3.0  # over ω, the time in which squares fade: half a period


class TimeError:
    """Estimates the error of displacements that each step makes at some points.

    Attributes:
        jerk: ĵ of the step that was looked at last, shape (points, 3) [m/s³]; NaN where unknown.
        swinging: Root mean square of the jerk over a turn, shape (points,) [m/s³]; NaN likewise.
    """

    remembered: ClassVar[Remembered] = same("_times", "_a", "_squares", "_patient")

    def __init__(self, points: int) -> None:
        """Nothing is known.

        Args:
            points: How many points there are.
        """
        self.jerk: Array = np.full((points, 3), nan)
        self.swinging: Array = self.jerk[:, 0]
        # Of the last steps: their middles [s], accelerations there, shape (steps, points, 3).
        self._times: tuple[float, ...] = ()
        self._a: Array = np.empty((0, points, 3))
        self._squares = 0.0, 0.0  # ∫ Σ |ĵ|² dt and ∫ Σ |â|² dt
        self._patient = False
        self._next: tuple[tuple[float, ...], Array, tuple[float, float]]
        self._next = self._times, self._a, self._squares

    def forget(self) -> None:
        """Something has happened that accelerations before do not know of."""
        self._times, self._a, self._patient = (), self._a[:0], False

    def switched(self) -> None:
        """Bodies have changed: jerks are no errors until three differences are known.

        Cells that wake spring into the shape that forces give them, faster than steps resolve: that
        rings from step to step, and only the mean of three is blind to it.
        """
        self.forget()
        self._patient = True

    @property
    def young(self) -> bool:
        """Whether three differences are not known yet, since something began anew."""
        return not self._patient and len(self._times) <= DIFFERENCES

    @property
    def omega(self) -> float:
        """ω [1/s]; zero while nothing has moved."""
        of_j, of_a = self._squares
        return sqrt(of_j / of_a) if of_a > 0 else 0.0

    def look(self, v0: Array, v1: Array, t: float, dt: float) -> Array:
        """Error of each point in a step that has been solved, shape (points,) [m]; NaN if unknown.

        Args:
            v0: Velocities at its start, shape (points, 3) [m/s].
            v1: Velocities at its end.
            t: Time at its start [s].
            dt: Its length [s].
        """
        times = (*self._times[-DIFFERENCES:], t + dt / 2)
        a: Array = np.concatenate([self._a[-DIFFERENCES:], ((v1 - v0) / dt)[None]])
        self._next, differences = (times, a, self._squares), len(times) - 1
        if differences <= (DIFFERENCES - 1) * self._patient:
            self.jerk, self.swinging = np.full_like(v0, nan), np.full(len(v0), nan)
            return self.swinging
        j = np.diff(a, axis=0) / np.diff(times)[:, None, None]
        self.jerk, mean = _mean(j), _mean(a)
        jerks, accelerations = ((x**2).sum(axis=1) for x in (self.jerk, mean))
        of_j, of_a = self._squares
        kept = exp(-self.omega * dt / TURN)
        of_j, of_a = of_j * kept + jerks.sum() * dt, of_a * kept + accelerations.sum() * dt
        self._next = times, a, (float(of_j), float(of_a))
        self.swinging = np.sqrt((jerks + (of_j / of_a if of_a > 0 else 0.0) * accelerations) / 2)
        return dt**3 / 12 * self.swinging

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._times, self._a, self._squares = self._next


def _mean(values: Array) -> Array:
    """Repeated mean of two among some values, shape (values, points, 3)."""
    mean = _binomial(len(values)) @ values.reshape(len(values), -1)
    return np.asarray(mean.reshape(values.shape[1:]))


@cache
def _binomial(count: int) -> Array:
    """Weights of repeated means of two among some values: ¼, ½, ¼ of three."""
    return np.array([comb(count - 1, k) for k in range(count)]) / 2.0 ** (count - 1)

"""Error of time integration in a step, from the velocities at its ends.

The local error of the midpoint rule is Δt³/12 times the jerk. With a = (v₁ - v₀)/Δt, which belongs
to the middle of a step, and the divided differences j = Δa/Δt of two steps,

    ĵ = ¼ j_{n-2} + ½ j_{n-1} + ¼ j_n ,    â = ⅛ (a_{n-3} + 3 a_{n-2} + 3 a_{n-1} + a_n) .

These means are blind to a change of sign from step to step: a vibration that a step does not
resolve rings like that, and is no error of the resolved motion. While there are fewer differences,
½ j_{n-1} + ½ j_n or j_n stand for ĵ, and the mean of their accelerations for â.

The jerk of a vibration is zero twice a period, and its error, which is one of its phase, goes on.
So the root mean square of the jerk over a turn of the phase counts: where it is ĵ now it is ω â a
quarter of a period away, and

    e = Δt³/12 sqrt(½ (|ĵ|² + ω² |â|²)) ,    ω² = ∫ Σ |ĵ|² dt / ∫ Σ |â|² dt ,

sums over all points, integrals over the last 3/ω, about half a period. Errors of one vibration add
up to √2 of Σ e, those of a steady turn to Σ e.
"""

from __future__ import annotations

from math import exp, nan, sqrt
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from rigidfx.base.remembered import Remembered, same

__all__ = ["TimeError"]

Array = npt.NDArray[np.float64]

# Weights of the differences of accelerations that are known, and of these, the newest last.
OF_JERKS = np.array([1.0]), np.array([0.5, 0.5]), np.array([0.25, 0.5, 0.25])
OF_ACCELERATIONS = (
    np.array([0.5, 0.5]),
    np.array([0.25, 0.5, 0.25]),
    np.array([0.125, 0.375, 0.375, 0.125]),
)
ENOUGH = len(OF_JERKS)
MEMORY = 3.0  # of 1/ω, in which squares are remembered that tell ω


class Known(NamedTuple):
    """Knowledge of the motion of some points.

    Attributes:
        t: Times of the last accelerations, the newest last, up to four [s].
        a: These, shape (up to 4, points, 3) [m/s²].
        jerks: ∫ Σ |ĵ|² dt, remembered for about half a period [m²/s⁵].
        accelerations: ∫ Σ |â|² dt, likewise [m²/s³].
    """

    t: tuple[float, ...]
    a: Array
    jerks: float
    accelerations: float

    @property
    def omega(self) -> float:
        """ω [1/s]; zero while nothing has moved."""
        return sqrt(self.jerks / self.accelerations) if self.accelerations > 0 else 0.0


class TimeError:
    """Estimates the error of displacements that each step makes at some points.

    Attributes:
        jerk: ĵ of the step that was looked at last, shape (points, 3) [m/s³]; NaN where unknown.
        swinging: Root mean square of the jerk over a turn, shape (points,) [m/s³]; NaN likewise.
    """

    remembered: ClassVar[Remembered] = same("_now", "_patient")

    def __init__(self, points: int) -> None:
        """Nothing is known.

        Args:
            points: How many points there are.
        """
        self._unknown: Array = np.full((points, 3), nan)
        self.jerk, self.swinging = self._unknown, self._unknown[:, 0]
        self._now = self._next = Known((), np.empty((0, points, 3)), 0.0, 0.0)
        self._patient = False

    def forget(self) -> None:
        """Something has happened that accelerations before do not know of."""
        self._now = self._now._replace(t=(), a=self._now.a[:0])
        self._patient = False

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
        return not self._patient and len(self._now.t) <= ENOUGH

    def look(self, v0: Array, v1: Array, t: float, dt: float) -> Array:
        """Error of each point in a step that has been solved, shape (points,) [m]; NaN if unknown.

        Args:
            v0: Velocities at its start, shape (points, 3) [m/s].
            v1: Velocities at its end.
            t: Time at its start [s].
            dt: Its length [s].
        """
        now = self._now
        times = (*now.t[-ENOUGH:], t + dt / 2)
        a: Array = np.concatenate([now.a[-ENOUGH:], ((v1 - v0) / dt)[None]])
        self._next, differences = now._replace(t=times, a=a), len(times) - 1
        if differences <= (ENOUGH - 1) * self._patient:
            self.jerk, self.swinging = self._unknown, self._unknown[:, 0]
            return self.swinging
        j = np.diff(a, axis=0) / np.diff(times)[:, None, None]
        self.jerk = np.einsum("k,kpi->pi", OF_JERKS[differences - 1], j)
        mean = np.einsum("k,kpi->pi", OF_ACCELERATIONS[differences - 1], a)
        jerks, accelerations = (np.einsum("pi,pi->p", x, x) for x in (self.jerk, mean))
        kept = exp(-now.omega * dt / MEMORY)
        self._next = known = self._next._replace(
            jerks=now.jerks * kept + float(jerks.sum()) * dt,
            accelerations=now.accelerations * kept + float(accelerations.sum()) * dt,
        )
        self.swinging = np.sqrt((jerks + known.omega**2 * accelerations) / 2)
        return dt**3 / 12 * self.swinging

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._now = self._next

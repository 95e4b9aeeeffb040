"""What time integration errs by in a step, from the velocities at its ends.

The local error of the midpoint rule is Δt³/12 times the jerk. With a = (v₁ - v₀)/Δt, which belongs
to the middle of a step, and the divided differences j = Δa/Δt of two steps,

    e = Δt³/12 ĵ,    ĵ = ¼ j_{n-2} + ½ j_{n-1} + ¼ j_n .

The mean over three differences is blind to what changes its sign from step to step: a vibration
that a step does not resolve rings like that, and is no error of the motion that it does. While
there are fewer, ½ j_{n-1} + ½ j_n or j_n stand for it.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["Jerk", "TimeError"]

Array = npt.NDArray[np.float64]

# Weights of the differences that are known, the newest last.
LOW_PASS = np.array([1.0]), np.array([0.5, 0.5]), np.array([0.25, 0.5, 0.25])
ENOUGH = len(LOW_PASS)


class Jerk(NamedTuple):
    """What is known of the accelerations of some points, of all alike.

    Attributes:
        a: The last acceleration, shape (points, 3) [m/s²]; None if none is known.
        t: Time that it belongs to [s].
        j: The last three differences, the newest last, shape (up to 3, points, 3) [m/s³].
    """

    a: Array | None
    t: float
    j: Array


class TimeError:
    """Estimates the error of displacements that each step makes at some points.

    Attributes:
        jerk: ĵ of the step that was looked at last, shape (points, 3) [m/s³]; NaN where unknown.
    """

    def __init__(self, points: int) -> None:
        """Nothing is known.

        Args:
            points: How many points there are.
        """
        self._unknown: Array = np.full((points, 3), nan)
        self.jerk = self._unknown
        self.forget()

    def forget(self) -> None:
        """Something has happened that accelerations before do not know of."""
        self._now = self._next = Jerk(None, 0.0, np.empty((0, *self._unknown.shape)))
        self._patient = False

    def switched(self) -> None:
        """Bodies have changed: what follows is no error until three differences tell.

        What wakes springs into the shape that its forces give it, faster than steps resolve: that
        rings from step to step, and only the mean of three is blind to it.
        """
        self.forget()
        self._patient = True

    @property
    def young(self) -> bool:
        """Whether three differences are not known yet, since something began anew."""
        return not self._patient and len(self._now.j) < ENOUGH

    def look(self, v0: Array, v1: Array, t: float, dt: float) -> Array:
        """Error of each point in a step that has been solved, shape (points,) [m]; NaN if unknown.

        Args:
            v0: Velocities at its start, shape (points, 3) [m/s].
            v1: Velocities at its end.
            t: Time at its start [s].
            dt: Its length [s].
        """
        now, middle, j = self._now, t + dt / 2, self._now.j
        a: Array = np.asarray((v1 - v0) / dt, dtype=np.float64)
        if now.a is not None:
            j = np.concatenate([j[len(j) == ENOUGH :], (a - now.a)[None] / (middle - now.t)])
        self._next = Jerk(a, middle, j)
        if len(j) > (ENOUGH - 1) * self._patient:
            self.jerk = np.einsum("k,kpi->pi", LOW_PASS[len(j) - 1], j)
        else:
            self.jerk = self._unknown
        return np.asarray(dt**3 / 12 * np.sqrt(np.einsum("pi,pi->p", self.jerk, self.jerk)))

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._now = self._next

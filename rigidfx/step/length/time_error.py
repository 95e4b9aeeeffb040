"""What time integration errs by in a step, from the velocities at its ends.

The local error of the midpoint rule is Δt³/12 times the jerk. With a = (v₁ - v₀)/Δt, which belongs
to the middle of a step, and the divided differences j = Δa/Δt of two steps,

    e = Δt³/12 ĵ,    ĵ = ¼ j_{n-2} + ½ j_{n-1} + ¼ j_n .

The mean over three differences is blind to what changes its sign from step to step: a vibration
that a step does not resolve rings like that, and is no error of the motion that it does. While
there are fewer, ½ j_{n-1} + ½ j_n or j_n stand for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

__all__ = ["Jerk", "TimeError"]

Array = npt.NDArray[np.float64]

LOW_PASS = np.array([0.25, 0.5, 0.25])  # of the last three differences, the newest last
YOUNGER = np.array([0.0, 0.5, 0.5])
YOUNGEST = np.array([0.0, 0.0, 1.0])


@dataclass
class Jerk:
    """What is known of the accelerations of some points; NaN where nothing is.

    Attributes:
        a: The last acceleration, shape (points, 3) [m/s²].
        t: Time that it belongs to [s].
        j: The last three differences, the newest last, shape (3, points, 3) [m/s³].
    """

    a: Array
    t: float = field(default=0.0)
    j: Array = field(default_factory=lambda: np.empty(0))


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
        self._points = points
        self.jerk: Array = np.full((points, 3), np.nan)
        self.forget()

    def forget(self) -> None:
        """Something has happened that accelerations before do not know of."""
        unknown = np.full((3, self._points, 3), np.nan)
        self._now = self._next = Jerk(unknown[0].copy(), -1.0, unknown)
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
        """Whether no point has three differences yet, since something began anew."""
        return not self._patient and bool(np.isnan(self._now.j).any(axis=(0, 2)).all())

    def look(self, v0: Array, v1: Array, t: float, dt: float) -> Array:
        """Error of each point in a step that has been solved, shape (points,) [m]; NaN if unknown.

        Args:
            v0: Velocities at its start, shape (points, 3) [m/s].
            v1: Velocities at its end.
            t: Time at its start [s].
            dt: Its length [s].
        """
        now, middle = self._now, t + dt / 2
        a: Array = np.asarray((v1 - v0) / dt, dtype=np.float64)
        newest = (a - now.a) / (middle - now.t)
        j = np.concatenate([now.j[1:], newest[None]])
        self._next = Jerk(a, middle, j)
        known = (~np.isnan(j[:, :, 0])).sum(axis=0)
        weights = np.where(known == 3, LOW_PASS[:, None], YOUNGER[:, None])
        weights = np.where(known == 1, YOUNGEST[:, None], weights)
        mean = np.einsum("kp,kpi->pi", weights, np.nan_to_num(j))
        told = known > 2 * self._patient
        self.jerk = np.where(told[:, None], mean, np.nan)
        return np.asarray(dt**3 / 12 * np.linalg.norm(self.jerk, axis=1))

    def accept(self) -> None:
        """Take note that the step that was looked at last is one."""
        self._now = self._next

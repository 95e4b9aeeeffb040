"""The error of displacements after many steps, from the errors of single steps.

An error is a motion. It decays as its vibration does, and the error of a vibration of amplitude A
is 2 A at most, when the phase is opposite. So the errors d of steps are split by octaves: E_b is
the error of motion slower than ω_b,

    E_b ← E_b exp(-δ_b Δt) + p_b d ,    δ_b = ½ (α + β min(½ω_b, ω)²) ,
    E = min_b ( max_{a ≤ b} E_a + 2 A_b ) .

p_b is the part of d/Δt that passes a chain of four exponential means, ω the
frequency at which errors turn (`rigidfx.step.length.time_error`). α and β are the least damping of
all cells (`rigidfx.scene.damped`). A_b is the amplitude of motion faster than ω_b: of displacements
high-passed four times at ½ω_b, so that both parts together are complete. The last ω_b is infinite.
With contacts it is the only one, since they turn fast motion into slow motion.

Four means pass 1/(1 + ω²/ω_b²)². Divided by δ_b this is largest at ω_b = ω, where it is right for
one vibration: 0.9 to 1 between octaves.
"""

from __future__ import annotations

from math import exp, log2
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Contact
from rigidfx.scene.damped import Damped
from rigidfx.scene.scene import Scene

__all__ = ["RunError"]


STAGES = 4  # of both filters: a flight that goes with t³ has no amplitude
OF_CUT = 0.5  # of ω_b: the frequency that is damped at δ_b, and above which A_b is found
PERIODS = 12.0  # over ½ω_b, the time in which an amplitude fades: two periods
STEPS = 14  # in which the mean part p_b of each account is found
LEAST = 1e-3  # of d, that the mean part of any account is at least


class RunError:
    """Adds up the errors of steps.

    Attributes:
        cuts: ω_b [1/s].
        rates: δ_b [1/s].
        error: E [m].
        largest: Largest E so far [m].
    """

    remembered: ClassVar[Remembered] = same(
        "rates", "error", "largest", "_low", "_high", "_sizes", "_parts", "_errors", "_shares"
    )

    def __init__(self, scene: Scene, points: int, time: float, step: float) -> None:
        """Nothing has moved. Collective.

        Args:
            scene: The problem.
            points: How many points are tracked.
            time: Length of the run: slower vibrations than one over it do not turn [s].
            step: Shortest Δt, which resolves none faster than one over it [s].
        """
        octaves = 0 if scene.named(Contact) else max(int(np.ceil(log2(time / step))), 1)
        self.cuts: Array = np.append(np.exp2(np.arange(octaves)) / time, np.inf)
        self._damped = Damped(scene)
        self.rates: Array = np.zeros(self.cuts.size)
        count = self.cuts.size
        self._parts, self._sizes, self._errors = np.ones(count), np.zeros(count), np.zeros(count)
        self._low: Array = np.zeros((1 + STAGES, count, 3 * points))
        self._high: Array = np.zeros((1 + STAGES, count, 3 * points))
        self._shares: Array = np.zeros((2, count))  # lately: of each, and of all
        # Added to what each account (column) allows within each bound (row).
        self._faster: Array = np.where(np.tri(count, dtype=bool), 0.0, np.inf)
        self._next_low, self._next_high = self._low, self._high
        self._next_sizes, self._next_parts = self._sizes, self._parts
        self.error = self.largest = 0.0

    def look(
        self, jerk: Array, swinging: Array, amplitudes: Array, omega: float, dt: float
    ) -> None:
        """Split the error of a step that has been solved.

        Args:
            jerk: Of each point, shape (points, 3) [m/s³]; NaN if unknown, of all alike.
            swinging: Root mean square of it over a turn, shape (points,) [m/s³]; NaN likewise.
            amplitudes: What `swings` gives, at the points that are asked for, shape (cuts,) [m].
            omega: Frequency at which errors turn [1/s].
            dt: Its length [s].
        """
        self.rates = self._damped.rates(np.minimum(OF_CUT * self.cuts, omega), dt)
        faded = self._sizes * np.exp(-OF_CUT * self.cuts * dt / PERIODS)
        self._next_sizes = np.maximum(faded, amplitudes)
        size = dt**2 * float(swinging.max(initial=0.0))
        self._next_low, self._next_parts = self._low, self._parts
        if size > 0:
            taken = -np.expm1(-self.cuts * dt)[:, None]
            self._next_low = low = np.empty_like(self._low)
            low[0] = dt**2 * jerk.ravel()
            for k in range(STAGES):
                low[k + 1] = self._low[k + 1] + taken * (low[k] - self._low[k + 1])
            self._next_parts = _lengths(low[-1]).max(axis=1) / size

    def swings(self, u: Array, dt: float) -> Array:
        """How far points at u, shape (points, 3), are off their motion below ½ω_b after dt [m, s].

        Returns:
            Shape (cuts, points) [m].
        """
        z = (OF_CUT * self.cuts * dt)[:, None]
        kept, taken = np.exp(-z), -np.expm1(-z) / z
        self._next_high = high = np.empty_like(self._high)
        high[0] = u.ravel()
        for k in range(STAGES):  # as if all went evenly within a step
            high[k + 1] = kept * self._high[k + 1] + taken * (high[k] - self._high[k])
        return _lengths(high[-1])

    def accept(self, error: float, dt: float) -> None:
        """Add the error of the step that was looked at last [m], of the length dt [s]."""
        self._low, self._high = self._next_low, self._next_high
        self._sizes, self._parts = self._next_sizes, self._next_parts
        now = error * self._parts
        self._errors = self._errors * np.exp(-self.rates * dt) + now
        self._shares = self._shares * exp(-1 / STEPS) + [now, np.full_like(now, error)]
        self.error = self.left(0.0)
        self.largest = max(self.largest, self.error)

    def left(self, time: float) -> float:
        """Error that is left after a time in which no step errs [m].

        Args:
            time: [s].
        """
        slower = np.maximum.accumulate(self._errors * np.exp(-self.rates * time))
        return float((slower + 2 * self._sizes).min())

    def rates_to(self, limits: Array, times: Array) -> Array:
        """Errors per time by which E comes to limits [m/s].

        Args:
            limits: Shape (n,) [m].
            times: When, shape (n,) [s].
        """
        gone = -np.expm1(-self.rates * times[:, None])  # of an error that is made now
        lasting = np.repeat(times[:, None], self.rates.size, axis=1)
        np.divide(gone, self.rates, out=lasting, where=self.rates > 0)
        mean, added = self._shares
        if added[0] > 0:
            lasting *= np.maximum(mean / added, LEAST)
        bounds = limits[:, None] - 2 * self._sizes
        # Of each bound the account that is full first; of all bounds the one that allows most.
        each = (bounds[:, :, None] - (self._errors * (1 - gone))[:, None]) / lasting[:, None]
        return np.asarray((each + self._faster).min(axis=2).max(axis=1))


def _lengths(vectors: Array) -> Array:
    """Lengths of vectors in rows of shape (3 points,), shape (rows, points)."""
    each = vectors.reshape(len(vectors), -1, 3)
    return np.asarray(np.sqrt(np.einsum("bpi,bpi->bp", each, each)))

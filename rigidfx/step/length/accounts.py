"""What steps have erred by so far, in accounts that forget at rates of their own.

Each has a part of a step's error, E ← E exp(-δ Δt) + p e; the largest of them is the error. What
may be spent per time is what leads none of them above a limit, each with the mean p of its last
steps.
"""

from __future__ import annotations

from math import exp

import numpy as np
import numpy.typing as npt

__all__ = ["Accounts"]

Array = npt.NDArray[np.float64]

STEPS = 14  # that tell which part of errors an account has
LEAST = 1e-3  # of an error, that any account may come to have
NEVER = 1e-9  # of an error, that is forgotten in no time


class Accounts:
    """Errors, and how they are forgotten.

    Attributes:
        rates: δ of each [1/s].
        parts: What each has of a step's error.
    """

    def __init__(self, count: int = 1) -> None:
        """Accounts of all errors, that forget nothing.

        Args:
            count: How many.
        """
        self.rates: Array = np.zeros(count)
        self.parts: Array = np.ones(count)
        self._errors: Array = np.zeros(count)
        self._lately: Array = np.zeros(count + 1)  # what each has had, and all that was added

    @property
    def largest(self) -> float:
        """The error now [m]."""
        return float(self._errors.max())

    def add(self, error: float, dt: float) -> None:
        """Add the error of a step [m], of the length dt [s], to what is left of those before."""
        now = error * self.parts
        self._errors = self._errors * np.exp(-self.rates * dt) + now
        self._lately = self._lately * exp(-1 / STEPS) + np.append(now, error)

    def left(self, time: float) -> float:
        """What is left after a time [s] in which nothing is added [m]."""
        return float((self._errors * np.exp(-self.rates * time)).max())

    def rate(self, end: float, time: float, *, anew: bool = False) -> float:
        """Error per time by which the largest account comes to a limit [m/s].

        Args:
            end: The limit [m].
            time: When [s].
            anew: Whether nothing has been spent before.
        """
        rates, start = self.rates, np.zeros(self.rates.size) if anew else self._errors
        gone = -np.expm1(-rates * time)  # of an error that is forgotten in it
        lasting = np.divide(gone, rates, out=np.full(rates.size, time), where=gone > NEVER)
        parts = np.ones(rates.size)
        if self._lately[-1] > 0:
            parts = np.maximum(self._lately[:-1] / self._lately[-1], LEAST)
        return float(((end - start * (1 - gone)) / (lasting * parts)).min())

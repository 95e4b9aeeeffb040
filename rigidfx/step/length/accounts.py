"""What steps have erred by so far, in accounts that forget at rates of their own.

Each has a part of a step's error, E ← E exp(-δ Δt) + p e; the largest of them is the error. What
may be spent per time is what leads none of them above a limit, each with the mean p of its last
steps. They are a dozen or two, mostly one: numbers, which Python handles sooner than arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, expm1, inf

__all__ = ["Accounts"]

STEPS = 14  # that tell which part of errors an account has
LEAST = 1e-3  # of an error, that any account may come to have
NEVER = 1e-9  # of an error, that is forgotten in no time


class Accounts:
    """Errors, and how they are forgotten.

    Attributes:
        rates: δ of each [1/s].
        parts: What each has of a step's error.
        largest: The error now [m].
    """

    def __init__(self, count: int = 1) -> None:
        """Accounts of all errors, that forget nothing.

        Args:
            count: How many.
        """
        self.rates: Sequence[float] = [0.0] * count
        self.parts: Sequence[float] = [1.0] * count
        self.largest = 0.0
        self._errors = [0.0] * count
        self._lately = [0.0] * count  # what each has had ...
        self._added = 0.0  # ... of all that was added
        self._shares = [1.0] * count

    def add(self, error: float, dt: float) -> None:
        """Add the error of a step [m], of the length dt [s], to what is left of those before."""
        kept = exp(-1 / STEPS)
        now = [error * part for part in self.parts]
        before = zip(self._errors, self.rates, strict=True)
        self._errors = [e * exp(-d * dt) + n for (e, d), n in zip(before, now, strict=True)]
        self._lately = [e * kept + n for e, n in zip(self._lately, now, strict=True)]
        self._added = self._added * kept + error
        self.largest = max(self._errors)
        if self._added > 0:
            self._shares = [max(lately / self._added, LEAST) for lately in self._lately]

    def left(self, time: float) -> float:
        """What is left after a time [s] in which nothing is added [m]."""
        return max(e * exp(-d * time) for e, d in zip(self._errors, self.rates, strict=True))

    def rate(self, end: float, time: float, *, anew: bool = False) -> float:
        """Error per time by which the largest account comes to a limit [m/s].

        Args:
            end: The limit [m].
            time: When [s].
            anew: Whether nothing has been spent before.
        """
        least = inf
        for error, rate, share in zip(self._errors, self.rates, self._shares, strict=True):
            gone = -expm1(-rate * time)  # of an error that is forgotten in it
            lasting = gone / rate if gone > NEVER else time
            start = 0.0 if anew else error * (1 - gone)
            least = min(least, (end - start) / (lasting * share))
        return least

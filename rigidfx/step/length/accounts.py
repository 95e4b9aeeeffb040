"""Errors of steps so far, in accounts that forget at rates of their own.

Each has a part of a step's error, E ← E exp(-δ Δt) + p e. Where they forget at different rates, the
largest of them is the error, and the rate of spending leads none above a limit. Where each is of
motion slower than some cut, and faster motion errs by twice its amplitude A at most, the least E +
2 A is the error, and the rate of spending leaves any of these below the limit. Each has the mean p
of its last steps. They are a dozen or two: numbers, which Python handles sooner than arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, expm1
from typing import ClassVar

from rigidfx.base.remembered import Remembered, same

__all__ = ["Accounts"]

STEPS = 14  # that tell which part of errors an account has
LEAST = 1e-3  # of an error, that any account may come to have
NEVER = 1e-9  # of an error, that is forgotten in no time


class Accounts:
    """Errors, and how they are forgotten.

    Attributes:
        rates: δ of each [1/s].
        parts: Part of a step's error in each.
        beyond: Largest error of faster motion, by accounts [m].
        error: The error now [m].
    """

    remembered: ClassVar[Remembered] = same(
        "rates", "parts", "beyond", "error", "_errors", "_lately", "_added", "_shares"
    )

    def __init__(self, count: int = 1, *, bounds: bool = False) -> None:
        """Accounts of all errors, that forget nothing.

        Args:
            count: How many.
            bounds: Whether each with faster motion is a bound of the error, so that the least
                counts, and not the largest.
        """
        self._counts, self._binds = (min, max) if bounds else (max, min)
        self.rates: Sequence[float] = [0.0] * count
        self.parts: Sequence[float] = [1.0] * count
        self.beyond: Sequence[float] = [0.0] * count
        self.error = 0.0
        self._errors = [0.0] * count
        self._lately = [0.0] * count  # what each has had ...
        self._added = 0.0  # ... of all that was added
        self._shares = [1.0] * count

    def add(self, error: float, dt: float) -> None:
        """Add the error of a step [m], of the length dt [s], to those before."""
        kept = exp(-1 / STEPS)
        now = [error * part for part in self.parts]
        before = zip(self._errors, self.rates, strict=True)
        self._errors = [e * exp(-d * dt) + n for (e, d), n in zip(before, now, strict=True)]
        self._lately = [e * kept + n for e, n in zip(self._lately, now, strict=True)]
        self._added = self._added * kept + error
        self.error = self.left(0.0)
        if self._added > 0:
            self._shares = [max(lately / self._added, LEAST) for lately in self._lately]

    def left(self, time: float) -> float:
        """The rest after a time [s] in which nothing is added [m]."""
        accounts = zip(self._errors, self.rates, self.beyond, strict=True)
        return self._counts(e * exp(-d * time) + more for e, d, more in accounts)

    def rate(self, end: float, time: float, *, anew: bool = False) -> float:
        """Error per time by which the error comes to a limit [m/s].

        Args:
            end: The limit [m].
            time: When [s].
            anew: Whether nothing has been spent before.
        """
        rates = []
        accounts = zip(self._errors, self.rates, self._shares, self.beyond, strict=True)
        for error, rate, share, more in accounts:
            gone = -expm1(-rate * time)  # of an error that is forgotten in it
            lasting = gone / rate if gone > NEVER else time
            start = 0.0 if anew else error * (1 - gone)
            rates.append((end - more - start) / (lasting * share))
        return self._binds(rates)

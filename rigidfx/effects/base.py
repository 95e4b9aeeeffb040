"""What all effects share: time windows and functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from math import inf, isfinite

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, numbers

__all__ = [
    "WHOLE",
    "Effect",
    "Table",
    "TimeFunction",
    "Vector",
    "Windowed",
]

Vector = tuple[float, float, float]
WHOLE = "all cells"  # what goes by this name is not a set of cells but the whole domain

TimeFunction = Callable[[float], float]


@dataclass(frozen=True)
class Table:
    """A piecewise linear function of time; constant before the first and after the last time.

    Every interior kink is a breakpoint at which a step ends.

    Attributes:
        times: Strictly increasing instants [s].
        values: Value at each instant, in the unit of what it multiplies.
    """

    times: Sequence[float]
    values: Sequence[float]

    def __post_init__(self) -> None:
        """Check the table.

        Raises:
            SceneError: If lengths differ, times do not increase or a number is not finite.
        """
        times, values = numbers(self.times), numbers(self.values)
        if times.ndim != 1 or times.shape != values.shape or times.size == 0:
            raise SceneError(
                "Table: times and values must be lists of numbers, of the same length ≥ 1."
            )
        if not (np.isfinite(times).all() and np.isfinite(values).all()):
            raise SceneError("Table: times and values must be finite.")
        if np.any(np.diff(times) <= 0):
            raise SceneError("Table: times must increase strictly; a jump takes a time window.")

    def __call__(self, t: float) -> float:
        """Value at time t [s]."""
        return float(np.interp(t, self.times, self.values))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Instants of the kinks [s]."""
        return tuple(float(t) for t in self.times)


@dataclass(frozen=True)
class Effect:
    """Anything a scene may name."""

    def __post_init__(self) -> None:
        """Check where it acts, if it acts somewhere.

        Raises:
            SceneError: If that is no name of a set; None will do where it is the default.
        """
        for place in (f for f in fields(self) if f.name == "where"):
            where = getattr(self, "where", None)
            if not isinstance(where, str) and (where is not None or place.default is not None):
                raise SceneError(
                    f"{type(self).__name__}: where must be the name of a set, got {where!r}."
                )


@dataclass(frozen=True)
class Windowed(Effect):
    """An effect that acts in a time window.

    Attributes:
        since: Start of the window [s].
        until: End of the window [s].
    """

    since: float = field(default=-inf, kw_only=True)
    until: float = field(default=inf, kw_only=True)

    def __post_init__(self) -> None:
        """Check the window.

        Raises:
            SceneError: If it is empty or its ends are not numbers.
        """
        super().__post_init__()
        owner = type(self).__name__
        since, until = (
            number(owner, name, getattr(self, name), infinite=True) for name in ("since", "until")
        )
        if not since < until:
            raise SceneError(
                f"{type(self).__name__}: the time window needs since < until, "
                f"got {self.since!r} … {self.until!r}."
            )

    def active(self, t: float) -> bool:
        """Whether the effect acts in a step whose midpoint is t [s]."""
        return self.since <= t <= self.until

    @property
    def ends(self) -> tuple[float, ...]:
        """Where the window begins and ends, as far as it does [s]."""
        return tuple(t for t in (self.since, self.until) if isfinite(t))

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Instants at which a step must end [s]: ends of the window, kinks of functions in it."""
        functions = (getattr(self, own.name) for own in fields(self))
        kinks = (t for f in functions for t in getattr(f, "breakpoints", ()))
        return (*self.ends, *(t for t in kinks if self.since < t < self.until))

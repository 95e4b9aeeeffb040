"""A controller of Δt: the longest steps whose errors, added up, keep the budget.

The error of a step is d = c Δt³, and r Δt of it is permitted, so the best length is

    Δt = safety √(r/c) ,                                                                    (1)

the deadbeat controller of an error per unit step (Hairer, Nørsett, Wanner, *Solving Ordinary
Differential Equations I*, 2nd ed., II.4; Söderlind, ACM TOMS 29 (2003) 1, section 3). c is the
envelope of d/Δt³: the errors of a vibration return, so c rises at once and fades over `memory`
steps. Inside a dead band Δt does not change, since another Δt costs new tangents. Δt grows only
after a longer one would have saved the cost of two changes. A step is repeated if d > reject r Δt.

With E the error of the run so far and U the largest displacement, r spends the rest of the budget
evenly up to the end T of the run, or, while a motion begins, in the time s in which it grows
fourfold, the step included,

    r = max( (share tol U - E)/(T - t) , (share tol U' - E)/(spread s) ) ,                  (2)

each no less than `poorest` of its value with E = 0. Without the second term a motion that begins
would have to keep a part of its still small displacement. E is damped
(`rigidfx.step.length.run_error`). U' is the displacement after the longest step, or after 4 s, with
the present velocity and acceleration; it is at most 4 U, and at most U times its former growth.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isnan, log2, sqrt
from typing import ClassVar, NamedTuple

import numpy as np

from rigidfx.base.course import Course
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.step.length.run_error import RunError

__all__ = ["NUMBERS", "Controller", "ControllerNumbers", "Moves"]


@dataclass(frozen=True)
class ControllerNumbers:
    """Numbers of the controller, found by scenes of `demos/benchmarks/budgets.py`.

    Attributes:
        share: Of the budget that estimates add up to: they may be half of the error.
        safety: Of the best Δt (Hairer, Nørsett, Wanner, II.4: 0.8 to 0.9).
        memory: Steps in which the envelope of d/Δt³ falls to 1/e of its value.
        shorter: Factor of Δt above which it stays as it is ...
        longer: ... and below which it does.
        least: Factor of a change (Hairer, Nørsett, Wanner, II.4: 0.2 to 0.5) ...
        most: ... and the largest one (1.5 to 5). With 4 the first steps of an arm of 20 073
            unknowns became so long that it rang, which took twice the time.
        reject: Times the allowed error of a step, above which it is repeated.
        spread: Times s, over which the budget of a motion that begins is spent.
        growth: Factor by which U has grown in s.
        rest: Part of the run over which the rest of the budget is spent at least.
        poorest: Of an even spending, the part that is always allowed.
        first: Parts of Δt that the first step after a breakpoint is, as nothing is known of it.
        price: Steps that two changes of Δt cost, over n^⅓ of n unknowns: factors are made anew.
    """

    share: float = 0.5
    safety: float = 0.9
    memory: float = 14.0
    shorter: float = 0.7
    longer: float = 1.5
    least: float = 0.5
    most: float = 2.0
    reject: float = 2.0
    spread: float = 2.5
    growth: float = 4.0
    rest: float = 0.1
    poorest: float = 0.25
    first: float = 16.0
    price: float = 0.2


NUMBERS = ControllerNumbers()
REST = 1e-7  # of the size of a cell: less than that is no displacement


class Moves(NamedTuple):
    """The largest displacement, velocity and acceleration of some points [m, m/s, m/s²]."""

    displacement: float
    speed: float
    acceleration: float


class Controller:
    """Chooses Δt; knows neither meshes nor motions.

    Attributes:
        tol: Error of the run over the largest displacement that may be; may be changed.
        wanted: Δt that is to be taken [s].
        shortest: Δt that is always long enough [s].
        longest: Δt that is never exceeded [s].
        error: Sum of the errors of steps.
        spent: Largest error so far [m].
    """

    remembered: ClassVar[Remembered] = same(
        "tol", "wanted", "spent", "_t", "_envelope", "_last", "_foreseen", "_lost"
    ) | {"_course": PART}

    def __init__(
        self,
        tol: float,
        t_end: float,
        error: RunError,
        shortest: float,
        longest: float,
        size: float,
        of: float | None = None,
    ) -> None:
        """Nothing has moved.

        Args:
            tol: Error of the run over the largest displacement.
            t_end: Length of the run [s].
            error: Sum of the errors of steps.
            shortest: Δt that is always long enough [s].
            longest: Δt that is never exceeded [s].
            size: Size of a cell [m].
            of: Displacement in place of the largest so far [m].
        """
        self.tol, self._t_end, self._of, self.error = tol, t_end, of, error
        self.wanted = self.longest = longest
        self.shortest, self.spent, self._t = shortest, 0.0, 0.0
        self._course, self._rest = Course(), REST * size if of is None else of
        self._foreseen = self.displacement
        self._envelope = self._last = self._lost = 0.0

    @property
    def displacement(self) -> float:
        """Largest displacement so far, or the user's value for it [m]."""
        return max(self._course.largest, self._rest)

    @property
    def used(self) -> float:
        """The part of the error that lasts to the end, over the largest displacement.

        With the safety of estimates.
        """
        left = self.error.left(max(self._t_end - self._t, 0.0))
        return left / (NUMBERS.share * self.displacement)

    def allowed(self, t: float, dt: float = 0.0) -> float:
        """Error per time that a step from t of the length dt [s] may spend, r of (2) [m/s]."""
        rest = max(self._t_end - t, NUMBERS.rest * self._t_end)
        spent = [(self.displacement, rest, self._t_end)]  # with what, in a time of a whole
        growing = self._growing(t) + dt
        if self._of is None and growing > 0:
            spent.append((self._foreseen, NUMBERS.spread * growing, NUMBERS.spread * growing))
        displacements, times, wholes = np.array(spent).T
        budgets = NUMBERS.share * self.tol * displacements
        rates = self.error.rates_to(budgets, times)
        return float(np.maximum(rates, NUMBERS.poorest * budgets / wholes).max())

    def _growing(self, t: float) -> float:
        """s: time in which the displacement has grown to its present size [s]."""
        return t - self._course.until(self._course.largest / NUMBERS.growth)

    def begins(self, t: float) -> bool:
        """Whether points are on their way from rest at t [s]: all steps err by much of nothing."""
        if self._of is not None:
            return False
        way = t - self._course.until(self._rest)  # t² grows fourfold in half of its time
        return self._course.largest <= self._rest or 3 * self._growing(t) < 2 * way

    def too_much(self, error: float, t: float, dt: float) -> bool:
        """Whether a step from t of the length dt [s] that errs [m] by so much is repeated."""
        return error > NUMBERS.reject * self.allowed(t, dt) * dt

    def overspends(self, error: float) -> bool:
        """Whether the run errs by more than its budget with a step that errs by so much [m]."""
        return self.error.error + error > NUMBERS.share * self.tol * self.displacement

    def halvings(self, error: float, t: float, dt: float) -> int:
        """How often a step that errs by too much has to be halved, by its error per Δt³."""
        much = error / (NUMBERS.reject * self.allowed(t, dt) * dt)
        return max(1, min(int(log2(much) / 2), int(log2(dt / self.shortest))))

    def begin(self) -> None:
        """Begin anew after a breakpoint."""
        self.wanted = max(self.wanted / NUMBERS.first, self.shortest)

    def accept(
        self, error: float, t: float, dt: float, now: Moves, young: bool, unknowns: int = 0
    ) -> None:
        """Take note of a step, and choose the next.

        Args:
            error: Its estimated error [m]; NaN if there is none.
            t: Time at its end [s].
            dt: Its length [s].
            now: How points move.
            young: Whether steps grow from small first ones.
            unknowns: Number of unknowns.
        """
        self._t = t
        if self._of is None:
            self._course.add(now.displacement, t - dt, t)
            self._foreseen = self._foresee(t, now)
        known = not isnan(error)
        if not known:
            error = min(self._last * dt**3, self.allowed(t - dt, dt) * dt)  # a likely one
        self.error.accept(error, dt)
        self.spent = max(self.spent, self.error.error)
        if not known:
            return
        self._last = error / dt**3
        self._envelope = max(self._last, self._envelope * exp(-1 / NUMBERS.memory))
        factor = min(max(NUMBERS.safety * self._best(t, dt) / dt, NUMBERS.least), NUMBERS.most)
        self._lost = self._lost + 1 - 1 / factor if factor > 1 else 0.0
        price = NUMBERS.price * unknowns ** (1 / 3)
        if factor < NUMBERS.shorter or (factor > NUMBERS.longer and (young or self._lost >= price)):
            self._lost = 0.0
            kept = self.wanted if factor > 1 else self.shortest  # a step may end at a breakpoint
            self.wanted = min(max(factor * dt, kept), self.longest)

    def _best(self, t: float, dt: float) -> float:
        """Length of a step from t with the error allowed of the length dt [s]."""
        if self._envelope == 0:
            return float("inf")
        return sqrt(self.allowed(t, dt) / self._envelope)

    def _foresee(self, t: float, now: Moves) -> float:
        """U' at a time [m]."""
        h, U = min(self.longest, NUMBERS.growth * self._growing(t)), self.displacement
        before = max(self._course.at(t - h), U / NUMBERS.growth)
        return min(U + now.speed * h + now.acceleration * h**2 / 2, U * U / before)

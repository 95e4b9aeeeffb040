"""Length of steps whose errors add up to the budget.

With r the error per time that may be spent, and c the envelope of e/Δt³ over the last steps, c Δt³
= r Δt gives Δt = 0.9 sqrt(r/c). The rate of spending is

    r = max( δ [½ tol U - E exp(-δ(T - t))]/[1 - exp(-δ(T - t))] ,
             max[tol U' - 2 E, ¼ tol U']/(5 s) ) ,

the rest of the budget evenly over the rest of the run, in bounds. E is the amount spent, all e
added up, of which damping lets a part δ per time be forgotten (`forgetting`; where fast motions are
forgotten sooner, the least of several accounts' r counts); without it the first is [½ tol U - E]/(T
- t). Of a single step no more than tol U/20 is allowed by it: where fast motion is bounded, little
has been seen of slow one as all begins, and nine tenths went to a first long step. U is the largest
displacement so far, and s the time in which it has grown to four times what it
was, the step itself included: a single one may not spend all of that either. A motion that begins
from rest would otherwise be computed to a part of almost nothing. So that it is not followed from
its first instant on as closely as later, U' is the expected displacement,

    U' = U + |v| h + ½ |a| h² ,    h the longest step, or 4 s if that is less ,

and no more than U times the factor by which it has grown in the last h: a swing stays.

Δt changes only where it is worth it, as factors kept for one Δt have to be made anew for another.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isnan, log2, nan, sqrt
from typing import ClassVar

from rigidfx.base.course import Course
from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.step.length.accounts import Accounts

__all__ = ["Moves", "StepLength"]

SHARE = 0.5  # of the budget that estimates are to add up to: they may be half of the error
SAFETY = 0.9
DECAY = exp(-1 / 14)  # of the envelope in a step
LONGER, SHORTER = 1.5, 0.7  # factors between which Δt stays as it is
THERE_AND_BACK = 2.0  # changes that a longer Δt costs, as it may have to be shortened again
MOST, LEAST = 1.7, 0.5  # factor of a change
MOST_YOUNG = 4.0  # while steps grow from the small first ones
EARLY = 5.0  # motions that begin may err by tol U/(5 s) per time
BEGINNING = 0.25  # of tol U', least that motions which begin may spend
SINGLE = 0.05  # of tol U, most that is allowed of a single step: what is bounded later is not yet
GROWN = 4.0  # factor of U in s
AHEAD = 4.0  # of s, in which a motion that grows may be expected to go on ...
# ... up to so many times U: with 16 a weight on a plate spent twice its share as it set in.
MOST_AHEAD = 4.0
POOREST, RICHEST = 0.1, 2.0  # of tol U/T, bounds of what is left
TRIALS = 3
OBJECTION = 2.0  # times what is asked, above which a step is repeated
ON_THE_WAY = 0.6  # of the time since rest: to four times as much, t² grows in half of its time
REST = 1e-7  # of the size of a cell: less than that is no displacement


@dataclass(frozen=True)
class Moves:
    """How points move, the largest of all.

    Attributes:
        displacement: [m].
        speed: [m/s].
        acceleration: [m/s²].
    """

    displacement: float
    speed: float = 0.0
    acceleration: float = 0.0


class StepLength:
    """Chooses Δt; knows neither meshes nor motions.

    Attributes:
        tol: Error of the run over the largest displacement that may be; may be changed.
        wanted: Δt that is to be taken [s].
        shortest: Δt that is always long enough [s].
        longest: Δt that is never exceeded [s].
        spent: Largest error so far [m].
        accounts: Errors of steps, and how they are forgotten.
        changes: How often Δt was changed for the sake of the error.
    """

    remembered: ClassVar[Remembered] = same(
        "tol",
        "wanted",
        "spent",
        "changes",
        "_t",
        "_envelope",
        "_last",
        "_foreseen",
        "_known",
        "_lost",
    ) | {"accounts": PART, "_course": PART}

    def __init__(
        self,
        tol: float,
        t_end: float,
        first: float,
        shortest: float,
        longest: float,
        size: float,
        of: float | None = None,
    ) -> None:
        """Nothing has moved.

        Args:
            tol: Error of the run over the largest displacement.
            t_end: Length of the run [s].
            first: Δt to begin with [s].
            shortest: Δt that is always long enough [s].
            longest: Δt that is never exceeded [s].
            size: Size of a cell [m].
            of: Displacement in place of the largest so far [m].
        """
        self.tol, self._t_end, self._of = tol, t_end, of
        self.wanted, self.longest, self.spent, self.changes = first, longest, 0.0, 0
        self.accounts, self._t = Accounts(), 0.0
        self._course, self.shortest = Course(REST * size if of is None else of), shortest
        self._envelope = self._last = 0.0
        self._foreseen = self.displacement
        self._known = nan, 0.0, 0.0  # what is left at a time, of a budget, with the rates of then
        self._lost = 0.0  # steps that a longer Δt would have saved

    @property
    def displacement(self) -> float:
        """Largest displacement so far, or the user's value for it [m]."""
        return self._course.largest

    def allowed(self, t: float, dt: float = 0.0) -> float:
        """Error per time that a step may spend, in m/s.

        Args:
            t: Time at its start [s].
            dt: Its length [s].
        """
        return self._begun(self._left(t), t, dt)

    def _left(self, t: float) -> float:
        """The rest of the budget over the rest of the run, in bounds [m/s]."""
        whole = self.tol * self.displacement
        if self._known[:2] != (t, whole):
            even = self.accounts.rate(whole, self._t_end, anew=True)
            left = self.accounts.rate(SHARE * whole, max(self._t_end - t, 0.01 * self._t_end))
            self._known = t, whole, min(max(left, POOREST * even), RICHEST * even)
        return self._known[2]

    def _begun(self, left: float, t: float, dt: float) -> float:
        """That, or more while a motion begins [m/s]."""
        if dt > 0:
            left = min(left, SINGLE * self.tol * self.displacement / dt)
        if self._of is not None:
            return left
        growing, whole = self._growing(t) + dt, self.tol * self._foreseen
        unspent = max(whole - self.accounts.error / SHARE, BEGINNING * whole)
        return max(left, unspent / (EARLY * growing)) if growing > 0 else left

    @property
    def used(self) -> float:
        """The part of the error that lasts to the end, over the largest displacement.

        With the safety of estimates.
        """
        left = self.accounts.left(max(self._t_end - self._t, 0.0))
        return left / (SHARE * self.displacement)

    def _growing(self, t: float) -> float:
        """Time in which the displacement has grown to its present size [s]."""
        return t - self._course.until(self.displacement / GROWN)

    def begins(self, t: float) -> bool:
        """Whether points have been on their way from rest for all of the time up to t [s].

        However short the first steps are, they err by a good part of next to nothing, as a
        displacement that grows with a power of the time says nothing about Δt.
        """
        if self._of is not None:
            return False
        rest = self._course.until(0.0)
        return not self._course.begun or self._growing(t) < ON_THE_WAY * (t - rest)

    def _foresee(self, t: float, now: Moves) -> None:
        """Expect that points go on as they move now, and U grows by no more than it has before."""
        h, U = min(self.longest, AHEAD * self._growing(t)), self.displacement
        expected = U + now.speed * h + now.acceleration * h**2 / 2
        known = self._course.begun and t - h > self._course.until(0.0)
        before = self._course.at(t - h) if known else 0.0
        self._foreseen = min(expected, U * (U / max(before, U / MOST_AHEAD)))

    def _spend(self, error: float, dt: float) -> None:
        """Add the error of a step to those before."""
        self.accounts.add(error, dt)
        self._known = nan, 0.0, 0.0
        self.spent = max(self.spent, self.accounts.error)

    def too_much(self, error: float, t: float, dt: float) -> bool:
        """Whether a step has to be repeated.

        Args:
            error: Its estimated error [m]; NaN if there is none.
            t: Time at its start [s].
            dt: Its length [s].
        """
        return error > OBJECTION * self.allowed(t, dt) * dt

    def halvings(self, error: float, t: float, dt: float) -> int:
        """How often a step that errs by too much has to be halved, by its error per Δt³.

        Arguments as of `too_much`.
        """
        much = error / (OBJECTION * self.allowed(t, dt) * dt)
        return max(1, min(int(log2(much) / 2), int(log2(dt / self.shortest))))

    def _best(self, t: float) -> float:
        """Length of a step from t [s] with the allowed error [s]."""
        if self._envelope == 0:
            return float("inf")
        left = self._left(t)
        best = sqrt(self._begun(left, t, 0.0) / self._envelope)
        for _ in range(TRIALS):  # of a length, which what is allowed depends on
            best = sqrt(best * sqrt(self._begun(left, t, best) / self._envelope))
        return best

    def begin(self, longest: float) -> None:
        """Begin anew after a breakpoint.

        Args:
            longest: Δt to begin with, at most [s].
        """
        self.wanted = min(self.wanted, longest)

    def accept(
        self, error: float, t: float, dt: float, now: Moves, young: bool, price: float = 0.0
    ) -> None:
        """Take note of a step, and choose the next.

        Args:
            error: Its estimated error [m]; NaN if there is none.
            t: Time at its end [s].
            dt: Its length [s].
            now: How points move.
            young: Whether steps grow from small first ones.
            price: Steps that another Δt costs.
        """
        self._t = t
        if self._of is None:
            self._course.add(now.displacement, t - dt, t)
            self._foresee(t, now)
        if isnan(error):  # of the size it was
            self._spend(self._last * dt**3, dt)
            return
        self._spend(error, dt)
        self._last = error / dt**3
        self._envelope = max(self._last, self._envelope * DECAY)
        factor = min(max(SAFETY * self._best(t) / dt, LEAST), MOST_YOUNG if young else MOST)
        self._lost = self._lost + 1 - 1 / factor if factor > 1 else 0.0
        longer = factor > LONGER and (young or self._lost >= THERE_AND_BACK * price)
        if longer or factor < SHORTER:
            self._lost = 0.0
            wanted = min(max(factor * dt, self.shortest), self.longest)
            self.changes += wanted != self.wanted
            self.wanted = wanted

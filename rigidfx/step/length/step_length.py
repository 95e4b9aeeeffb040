"""How long steps may be so that their errors add up to what is asked.

With r the error per time that may be spent, and c the envelope of e/Δt³ over the last steps,
c Δt³ = r Δt gives Δt = 0.9 sqrt(r/c). What may be spent is

    r = max( [0.6 tol U - Σe]/(T - t) ,  tol U/(5 s) ),

the rest of the budget evenly over the rest of the run, in bounds; U is the largest displacement
so far, and s the time in which it has grown to four times what it was. A motion that begins from
rest would otherwise be computed to a part of what is next to nothing. Δt changes only where it is
worth it, as what is kept for one Δt has to be made anew for another.
"""

from __future__ import annotations

from bisect import bisect_right
from math import exp, isnan, sqrt

__all__ = ["StepLength"]

SHARE = 0.6  # of the budget that estimates are to add up to: they are 0.5 to 2.5 times the error
SAFETY = 0.9
DECAY = exp(-1 / 20)  # of the envelope in a step
LONGER, SHORTER = 1.33, 0.8  # factors between which Δt stays as it is
MOST, LEAST = 1.5, 0.5  # factor of a change
MOST_YOUNG = 4.0  # while steps grow from the small first ones
EARLY = 5.0  # motions that begin may err by tol U/(5 s) per time
GROWN = 4.0  # factor of U in s
POOREST, RICHEST = 0.1, 2.0  # of tol U/T, bounds of what is left
OBJECTION = 2.0  # times what is asked, above which a step is repeated
REST = 1e-7  # of the size of a cell: less than that is no displacement
APART = 1.02  # factor of displacements that are remembered


class StepLength:
    """Chooses Δt; knows neither meshes nor motions.

    Attributes:
        wanted: Δt that is to be taken [s].
        shortest: Δt that is always long enough [s].
        longest: Δt that is never exceeded [s].
        spent: Errors so far, added up [m].
        displacement: Largest displacement so far, or what the user gave for it [m].
        changes: How often Δt was changed for the sake of the error.
    """

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
        self._tol, self._t_end, self._of = tol, t_end, of
        self.wanted, self.longest, self.spent, self.changes = first, longest, 0.0, 0
        self.displacement = REST * size if of is None else of
        self.shortest = shortest
        self._times, self._sizes = [0.0], [self.displacement]
        self._envelope = self._last = 0.0

    def allowed(self, t: float) -> float:
        """Error per time that may be spent at t [s], in m/s."""
        whole = self._tol * self.displacement
        even = whole / self._t_end
        left = (SHARE * whole - self.spent) / max(self._t_end - t, 0.01 * self._t_end)
        left = min(max(left, POOREST * even), RICHEST * even)
        if self._of is not None:
            return left
        k = max(bisect_right(self._sizes, self.displacement / GROWN) - 1, 0)
        growing = t - self._times[k]
        return max(left, whole / (EARLY * growing)) if growing > 0 else left

    def too_much(self, error: float, t: float, dt: float) -> bool:
        """Whether a step has to be repeated.

        Args:
            error: Its estimated error [m]; NaN if there is none.
            t: Time at its start [s].
            dt: Its length [s].
        """
        return error > OBJECTION * self.allowed(t) * dt

    def begin(self, longest: float) -> None:
        """Begin anew after a breakpoint.

        Args:
            longest: Δt to begin with, at most [s].
        """
        self.wanted = min(self.wanted, longest)

    def accept(self, error: float, t: float, dt: float, largest: float, young: bool) -> None:
        """Take note of a step, and choose the next.

        Args:
            error: Its estimated error [m]; NaN if there is none.
            t: Time at its end [s].
            dt: Its length [s].
            largest: Largest displacement now [m].
            young: Whether steps grow from small first ones.
        """
        if self._of is None and largest > self.displacement:
            self.displacement = largest
            if largest > APART * self._sizes[-1]:
                self._times[-1] = t - dt  # until then it was no more
                self._times.append(t)
                self._sizes.append(largest)
        if isnan(error):  # of the size it was
            self.spent += self._last * dt**3
            return
        self.spent += error
        self._last = error / dt**3
        self._envelope = max(self._last, self._envelope * DECAY)
        best = sqrt(self.allowed(t) / self._envelope) if self._envelope > 0 else float("inf")
        factor = min(max(SAFETY * best / dt, LEAST), MOST_YOUNG if young else MOST)
        if factor > LONGER or factor < SHORTER:
            wanted = min(max(factor * dt, self.shortest), self.longest)
            self.changes += wanted != self.wanted
            self.wanted = wanted

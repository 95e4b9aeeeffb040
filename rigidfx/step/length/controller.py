"""A controller of Δt: the longest steps whose errors, added up, keep the budget.

docs/theory/time_steps.md has the error of a run, (6) and (7), and the next Δt, (8).
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from math import exp, inf, isnan, log2, sqrt
from typing import ClassVar, NamedTuple

import numpy as np

from rigidfx.base.remembered import PART, Remembered, same
from rigidfx.base.types import Array
from rigidfx.effects import Contact
from rigidfx.scene.damped import Damped
from rigidfx.scene.scene import Scene

STAGES = 4  # of both filters: a flight that goes with t³ has no amplitude
OF_CUT = 0.5  # of ω_b: the frequency that is damped at δ_b, and above which A_b is found
PERIODS = 12.0  # over ½ω_b, the time in which an amplitude fades: two periods
STEPS = 14  # in which the mean part p_b of each account is found
LEAST = 1e-3  # of d, that the mean part of any account is at least

APART = 1.02  # factor between largest values that are remembered


class Course:
    """The largest value so far, and its past values."""

    remembered: ClassVar[Remembered] = same("largest", "_times", "_sizes")

    def __init__(self) -> None:
        """It is zero at the time 0."""
        self.largest = 0.0
        # Until when it was no more than that; the last one may still be.
        self._times, self._sizes = [0.0], [0.0]

    def add(self, value: float, start: float, t: float) -> None:
        """Record a value, reached between two times [s]."""
        if self.largest == value == 0:
            self._times[0] = t
        if value <= self.largest:
            return
        self.largest = value
        if value > APART * self._sizes[-1]:
            self._times[-1] = start
            self._times.append(t)
            self._sizes.append(value)

    def at(self, t: float) -> float:
        """The largest value up to t [s]."""
        return self._sizes[min(bisect_left(self._times, t), len(self._sizes) - 1)]

    def until(self, value: float) -> float:
        """Time up to which it was no more than a value [s]."""
        return self._times[max(bisect_right(self._sizes, value) - 1, 0)]


class RunError:
    """Adds up the errors of steps by octaves, as they decay: (6) and (7).

    p_b is right for one vibration (0.9 to 1 between octaves); r takes the mean of late, and all of
    one step that spends evenly beside: rounding alone tells no part. The share of p_b that longer
    steps have left is not in r. Faster motion errs by twice its amplitude at most, and E may be
    half of the error: so E has the amplitude once.

    Attributes:
        cuts: ω_b [1/s].
        rates: δ_b [1/s].
        error: E [m].
        largest: Largest E so far [m].
        theirs: By what bodies let displacements err [m]. Where they lose cells they leave swings of
            that size: to follow these, a bar that bent by 3 % of its length took 36 000 steps in
            place of 5300.
    """

    remembered: ClassVar[Remembered] = same(
        *("rates", "error", "largest", "_low", "_jerks", "_high", "_sizes", "_parts", "_own"),
        *("_errors", "_shares", "theirs"),
    )

    def __init__(self, scene: Scene, points: int, time: float, step: float) -> None:
        """Nothing has moved at some points in a run of some time [s]. Collective.

        Slower vibrations than one over its time do not turn, and the shortest step [s] resolves
        none faster than one over it.
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
        # The same of jerks, in which longer steps before weigh no more than others.
        self._jerks, self._own = self._low.copy(), self._parts.copy()
        self._next_low, self._next_jerks, self._next_high = self._low, self._jerks, self._high
        self._next_sizes, self._next_parts, self._next_own = self._sizes, self._parts, self._own
        self.error = self.largest = self.theirs = 0.0

    def look(
        self, jerk: Array, swinging: Array, amplitudes: Array, omega: float, dt: float
    ) -> None:
        """Split the error of a step of Δt [s] that has been solved.

        Points have a jerk (points, 3) and its root mean square over a turn (points,) [m/s³], NaN if
        unknown; amplitudes are those of `swings`, (cuts,) [m], and errors turn at ω [1/s].
        """
        self.rates = self._damped.rates(np.minimum(OF_CUT * self.cuts, omega), dt)
        faded = self._sizes * np.exp(-OF_CUT * self.cuts * dt / PERIODS)
        self._next_sizes = np.maximum(faded, amplitudes)
        size = dt**2 * float(swinging.max(initial=0.0))
        self._next_low, self._next_jerks = self._low, self._jerks
        self._next_parts, self._next_own = self._parts, self._own
        if isnan(size):
            self._next_parts, self._next_own = self._parts.copy(), self._own.copy()
            self._next_parts[-1] = self._next_own[-1] = 1.0  # nothing is faster than that
        if size > 0:
            taken = -np.expm1(-self.cuts * dt)[:, None]
            self._next_low = _passed(self._low, dt**2 * jerk.ravel(), taken)
            self._next_jerks = _passed(self._jerks, jerk.ravel(), taken)
            self._next_parts = _lengths(self._next_low[-1]).max(axis=1) / size
            own = dt**2 * _lengths(self._next_jerks[-1]).max(axis=1) / size
            self._next_own = np.minimum(own, self._next_parts)

    def swings(self, before: Array, u: Array, dt: float) -> Array:
        """How far points are off their motion below ½ω_b, shape (cuts, points) [m].

        They have moved in dt [s] to displacements u, shape (points, 3) each [m]. Where a run
        begins, and how far points go as bodies leave their shapes, is no motion.
        """
        z = (OF_CUT * self.cuts * dt)[:, None]
        kept, taken = np.exp(-z), -np.expm1(-z) / z
        self._next_high = high = np.empty_like(self._high)
        high[0], was = u.ravel(), before.ravel()
        for k in range(STAGES):  # as if all went evenly within a step
            high[k + 1] = kept * self._high[k + 1] + taken * (high[k] - was)
            was = self._high[k + 1]
        return _lengths(high[-1])

    def accept(self, error: float, dt: float) -> None:
        """Add the error of the step that was looked at last [m], of the length dt [s]."""
        self._low, self._jerks, self._high = self._next_low, self._next_jerks, self._next_high
        self._sizes, self._parts, self._own = self._next_sizes, self._next_parts, self._next_own
        self._errors = self._errors * np.exp(-self.rates * dt) + error * self._parts
        now = error * np.array([self._own, np.ones_like(self._own)])
        self._shares = self._shares * exp(-1 / STEPS) + now
        self.error = self.left(0.0)
        self.largest = max(self.largest, self.error)

    def left(self, time: float) -> float:
        """Error that is left after a time in which no step errs [m]."""
        slower = np.maximum.accumulate(self._errors * np.exp(-self.rates * time))
        return float((slower + self._swings).min())

    @property
    def _swings(self) -> Array:
        """Amplitudes that may err by more than bodies do, and are followed, (cuts,) [m]."""
        return np.maximum(self._sizes - self.theirs / 2, 0.0)  # as a swing errs by twice its own

    def rates_to(self, limits: Array, times: Array, dt: float) -> Array:
        """Errors per time by which E comes to limits after times, shape (n,) each [m/s, m, s].

        A step of the length dt [s] that spends evenly tells no account's part.
        """
        gone = -np.expm1(-self.rates * times[:, None])  # of an error that is made now
        lasting = np.repeat(times[:, None], self.rates.size, axis=1)
        np.divide(gone, self.rates, out=lasting, where=self.rates > 0)
        even = (limits * dt / times)[:, None]
        mean, added = self._shares
        lasting *= np.maximum((mean + even) / (added + even), LEAST)
        bounds = limits[:, None] - self._swings
        # Of each bound the account that is full first; of all bounds the one that allows most.
        each = (bounds[:, :, None] - (self._errors * (1 - gone))[:, None]) / lasting[:, None]
        return np.asarray((each + self._faster).min(axis=2).max(axis=1))


def _passed(low: Array, values: Array, taken: Array) -> Array:
    """Low-passed values, in the shape of `low`, after the next ones."""
    out: Array = np.empty_like(low)
    out[0] = values
    for k in range(STAGES):
        out[k + 1] = low[k + 1] + taken * (out[k] - low[k + 1])
    return out


def _lengths(vectors: Array) -> Array:
    """Lengths of vectors in rows of shape (3 points,), shape (rows, points)."""
    each = vectors.reshape(len(vectors), -1, 3)
    return np.asarray(np.sqrt(np.einsum("bpi,bpi->bp", each, each)))


@dataclass(frozen=True)
class ControllerNumbers:
    """Numbers of the controller, found by scenes of `demos/benchmarks/budgets.py`."""

    share: float = 0.5  # of the budget that estimates add up to: they may be half of the error
    safety: float = 0.9  # of the best Δt (Hairer, Nørsett, Wanner, II.4: 0.8 to 0.9)
    memory: float = 14.0  # steps in which the envelope of d/Δt³ falls to 1/e of its value
    shorter: float = 0.7  # factor of Δt above which it stays as it is ...
    longer: float = 1.5  # ... and below which it does
    least: float = 0.5  # factor of a change (Hairer, Nørsett, Wanner, II.4: 0.2 to 0.5) ...
    # ... and the largest one (1.5 to 5). With 4 the first steps of an arm of 20 073 unknowns became
    # so long that it rang, which took twice the time
    most: float = 2.0
    reject: float = 2.0  # times the allowed error of a step, above which it is repeated
    spread: float = 2.5  # times s, over which the budget of a motion that begins is spent
    growth: float = 4.0  # factor by which U has grown in s
    rest: float = 0.1  # part of the run over which the rest of the budget is spent at least
    poorest: float = 0.25  # of an even spending, the part that is always allowed
    # Parts of Δt that the first step after a breakpoint is, as nothing is known of it
    first: float = 16.0
    # Steps that two changes of Δt cost, over n^⅓ of n unknowns: factors are made anew
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
        "tol", "wanted", "spent", "_t", "_dt", "_envelope", "_last", "_foreseen", "_lost"
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
        """Nothing has moved in a run up to t_end [s], in cells of some size [m]."""
        self.tol, self._t_end, self._of, self.error = tol, t_end, of, error
        self.wanted = self.longest = longest
        self.shortest, self.spent, self._t, self._dt = shortest, 0.0, 0.0, 0.0
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

    def allowed(self, t: float, dt: float) -> float:
        """Error per time that a step from t of the length dt [s] may spend, r [m/s]."""
        rest = max(self._t_end - t, NUMBERS.rest * self._t_end)
        spent = [(self.displacement, rest, self._t_end)]  # with what, in a time of a whole
        growing = self._growing(t) + dt
        if self._of is None and growing > 0:
            spent.append((self._foreseen, NUMBERS.spread * growing, NUMBERS.spread * growing))
        displacements, times, wholes = np.array(spent).T
        budgets = NUMBERS.share * self.tol * displacements
        rates = self.error.rates_to(budgets, times, dt)
        return float(np.maximum(rates, NUMBERS.poorest * budgets / wholes).max())

    def _growing(self, t: float) -> float:
        """s: time in which the displacement has grown to its present size [s]."""
        return t - self._course.until(self._course.largest / NUMBERS.growth)

    def begins(self, t: float) -> bool:
        """Whether points are on their way from rest at t [s]: all steps err by much of nothing."""
        if self._of is not None:
            return False
        if self._course.largest <= NUMBERS.growth * self._rest:
            return True
        way = t - self._course.until(self._rest)  # t² grows fourfold in half of its time
        return 3 * (self._growing(t) - self._dt) < 2 * way  # when in a step is not known

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
        """Record a step of Δt that ends at t [s] with an error [m], and choose the next.

        The error is NaN if unknown. Steps grow from small first ones while young.
        """
        self._t, self._dt = t, dt
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
        kept = 0.0 if young else exp(-1 / NUMBERS.memory)  # what began errs once, not for long
        self._envelope = max(self._last, self._envelope * kept)
        best = sqrt(self.allowed(t, dt) / self._envelope) if self._envelope else inf
        factor = min(max(NUMBERS.safety * best / dt, NUMBERS.least), NUMBERS.most)
        self._lost = self._lost + 1 - 1 / factor if factor > 1 else 0.0
        price = NUMBERS.price * unknowns ** (1 / 3)
        if factor < NUMBERS.shorter or (factor > NUMBERS.longer and (young or self._lost >= price)):
            self._lost = 0.0
            kept = self.wanted if factor > 1 else self.shortest  # a step may end at a breakpoint
            self.wanted = min(max(factor * dt, kept), self.longest)

    def _foresee(self, t: float, now: Moves) -> float:
        """U' at a time [m]."""
        h, U = min(self.longest, NUMBERS.growth * self._growing(t)), self.displacement
        before = max(self._course.at(t - h), U / NUMBERS.growth)
        return min(U + now.speed * h + now.acceleration * h**2 / 2, U * U / before)

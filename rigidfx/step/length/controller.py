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
from rigidfx.step.length.time_error import TURN

STAGES = 4  # of both filters: a flight that goes with t³ has no amplitude
OF_CUT = 0.5  # of ω_b: the frequency that is damped at δ_b, and above which A_b is found
PERIODS = 12.0  # over ½ω_b, the time in which an amplitude fades: two periods
LEAST = 1e-3  # of d, that the part of any account is at least

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


class SlowParts:
    """The parts p_b of a step's error that belong to motion slower than each ω_b: (6a)."""

    remembered: ClassVar[Remembered] = same("_parts", "_low", "_begun", "_squares")

    def __init__(self, cuts: Array, points: int) -> None:
        """Nothing has moved at some points; cuts are ω_b, the last one infinite [1/s]."""
        self._cuts, self._points, count = cuts, points, cuts.size
        self._parts: Array = np.ones(count)
        # Jerks, Δt² times these, and their sizes, low-passed at each cut; their squares over a turn
        self._low: Array = np.zeros((1 + STAGES, count, 7 * points))
        self._squares: Array = np.zeros((3, count, points))
        # One since the last breakpoint, low-passed likewise: 1 - c_b in the last stage
        self._begun: Array = np.zeros((1 + STAGES, count, 1))
        self._next: tuple[Array, ...] = self._parts, self._low, self._begun, self._squares

    def look(self, jerk: Array, swinging: Array, dt: float) -> Array:
        """p_b of a step of Δt [s] that has been solved, shape (cuts,); as before if unknown.

        Points have a jerk (points, 3) and its root mean square over a turn (points,) [m/s³].
        """
        size, P = float(swinging.max(initial=0.0)), self._points
        if not size > 0:  # or unknown
            self._next = self._parts, self._low, self._begun, self._squares
            return self._parts
        taken = -np.expm1(-self._cuts * dt)[:, None]
        every = np.concatenate([jerk.ravel(), dt**2 * jerk.ravel(), swinging])
        low, begun = _passed(self._low, every, taken), _passed(self._begun, np.ones(1), taken)
        vectors = low[-1, :, : 6 * P].reshape(-1, 2, P, 3)
        of_vectors = np.einsum("bkpi,bkpi->kbp", vectors, vectors)
        squares = np.concatenate([of_vectors, low[-1:, :, 6 * P :] ** 2])
        squares += np.exp(-self._cuts * dt / TURN)[:, None] * (self._squares - squares)
        jerks, errors, sizes = np.sqrt(squares.max(axis=2))
        known, c = np.minimum(jerks, errors / dt**2) / size, 1 - begun[-1, :, 0]
        known, mean = np.minimum(known, 1.0), np.minimum(jerks / sizes, 1.0)
        known[-1] = mean[-1] = 1.0  # nothing is faster than that
        # Motion slower than a cut is slower than those above it, too, whose filters know it sooner.
        most = np.minimum.accumulate(((1 - c) * known + c * mean)[::-1])[::-1]
        parts = (1 - c) * known + c * most
        self._next = parts, low, begun, squares
        return parts

    def accept(self) -> None:
        """Accept the step that was looked at last."""
        self._parts, self._low, self._begun, self._squares = self._next

    def restart(self) -> None:
        """Something begins of which filters know nothing yet."""
        self._begun = np.zeros_like(self._begun)


class RunError:
    """Adds up the errors of steps by octaves, as they decay: (6) and (7).

    Attributes:
        cuts: ω_b [1/s].
        rates: δ_b [1/s].
        parts: p_b of the step that was looked at last.
        error: E [m].
        largest: Largest E so far [m].
        theirs: By what bodies let displacements err [m]. Where they lose cells they leave swings of
            that size: to follow these, a bar that bent by 3 % of its length took 36 000 steps in
            place of 5300.
    """

    remembered: ClassVar[Remembered] = same(
        *("rates", "parts", "error", "largest", "theirs", "_high", "_sizes", "_errors"),
    ) | {"_split": PART}

    def __init__(self, scene: Scene, points: int, time: float, step: float) -> None:
        """Nothing has moved at some points in a run of some time [s]. Collective.

        Slower vibrations than one over its time do not turn, and the shortest step [s] resolves
        none faster than one over it.
        """
        octaves = 0 if scene.named(Contact) else max(int(np.ceil(log2(time / step))), 1)
        self.cuts: Array = np.append(np.exp2(np.arange(octaves)) / time, np.inf)
        self._damped, self._split = Damped(scene), SlowParts(self.cuts, points)
        self.rates: Array = np.zeros(self.cuts.size)
        count = self.cuts.size
        self.parts: Array = np.ones(count)
        self._sizes, self._errors = np.zeros(count), np.zeros(count)
        self._high: Array = np.zeros((1 + STAGES, count, 3 * points))
        # Added to what each account (column) allows within each bound (row).
        self._faster: Array = np.where(np.tri(count, dtype=bool), 0.0, np.inf)
        self._next_high, self._next_sizes = self._high, self._sizes
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
        self.parts = self._split.look(jerk, swinging, dt)

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
        each = high[-1].reshape(self.cuts.size, -1, 3)
        return np.asarray(np.sqrt(np.einsum("bpi,bpi->bp", each, each)))

    def accept(self, error: float, dt: float) -> None:
        """Add the error of the step that was looked at last [m], of the length dt [s]."""
        self._split.accept()
        self._high, self._sizes = self._next_high, self._next_sizes
        self._errors = self._errors * np.exp(-self.rates * dt) + error * self.parts
        self.error = self.left(0.0)
        self.largest = max(self.largest, self.error)

    def restart(self) -> None:
        """Something begins, of which nothing is known yet."""
        self._split.restart()

    def left(self, time: float) -> float:
        """Error that is left after a time in which no step errs [m]."""
        slower = np.maximum.accumulate(self._errors * np.exp(-self.rates * time))
        return float((slower + self._swings).min())

    @property
    def _swings(self) -> Array:
        """Amplitudes that may err by more than bodies do, and are followed, (cuts,) [m]."""
        return np.maximum(self._sizes - self.theirs / 2, 0.0)  # as a swing errs by twice its own

    def rate_to(self, limits: Array, times: Array, least: Array, parts: Array) -> float:
        """Error per time by which E comes to one of n limits after a time, the most [m/s].

        Limits and times have the shape (n,) [m, s]. Accounts get parts of the error, (cuts,), and
        may get the least in any case, (n,) [m/s].
        """
        gone = -np.expm1(-self.rates * times[:, None])  # of an error that is made now
        lasting = np.repeat(times[:, None], self.rates.size, axis=1)
        np.divide(gone, self.rates, out=lasting, where=self.rates > 0)
        bounds = limits[:, None] - self._swings
        each = (bounds[:, :, None] - (self._errors * (1 - gone))[:, None]) / lasting[:, None]
        always = np.where(bounds > 0, least[:, None], -inf)
        each = np.maximum(each, always[:, :, None]) / np.maximum(parts, LEAST)
        # Of each bound the account that is full first; of all bounds the one that allows most.
        return float(max((each + self._faster).min(axis=2).max(), least.max()))


def _passed(low: Array, values: Array, taken: Array) -> Array:
    """Low-passed values, in the shape of `low`, after the next ones."""
    out: Array = np.empty_like(low)
    out[0] = values
    for k in range(STAGES):
        out[k + 1] = low[k + 1] + taken * (out[k] - low[k + 1])
    return out


@dataclass(frozen=True)
class ControllerNumbers:
    """Numbers of the controller, found by scenes of `demos/benchmarks/budgets.py`."""

    share: float = 0.5  # of the budget that estimates add up to: they may be half of the error
    safety: float = 0.9  # of the best Δt (Hairer, Nørsett, Wanner, II.4: 0.8 to 0.9)
    memory: float = 14.0  # steps in which an envelope of p d/Δt³ falls to 1/e of its value
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
        "tol", "wanted", "spent", "_t", "_dt", "_envelopes", "_last", "_foreseen", "_lost"
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
        self._envelopes: Array = np.zeros(error.cuts.size)
        self._last = self._lost = 0.0

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

    def allowed(self, t: float, dt: float, parts: Array | None = None) -> float:
        """Error per time that a step from t of the length dt [s] may spend, r [m/s].

        Accounts get parts of it, as of the step that was looked at last unless they are given.
        """
        rest = max(self._t_end - t, NUMBERS.rest * self._t_end)
        spent = [(self.displacement, rest, self._t_end)]  # with what, in a time of a whole
        growing = self._growing(t) + dt
        if self._of is None and growing > 0:
            spent.append((self._foreseen, NUMBERS.spread * growing, NUMBERS.spread * growing))
        displacements, times, wholes = np.array(spent).T
        budgets = NUMBERS.share * self.tol * displacements
        least = NUMBERS.poorest * budgets / wholes
        parts = self.error.parts if parts is None else parts
        return self.error.rate_to(budgets, times, least, parts)

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
        self._envelopes = np.maximum(self._last * self.error.parts, self._envelopes * kept)
        most = self._envelopes.max()
        best = sqrt(self.allowed(t, dt, self._envelopes / most) / most) if most else inf
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

"""The rule of `Accuracy`: what rigidity takes from a motion stays below a budget.

A displacement is a sum over cells, u = ∫ σ : ε dV, σ the stresses of a unit force there. What
bodies withhold of their cells' strains, s, takes a part of it; with the largest strains so far, S,
in the place of σ, which are those of the motion that the budget is a part of,

    m = Σ w S s / Σ w S² ,    w = C V   of each cell, sums over rigid cells, and all.

Of a steady motion s = S, and m is E_w/H, the strain energy withheld over that of deformation; of a
vibration that has come down to a part r it is r E_w/H. A frequency is off by E_w/2H (Rayleigh), the
motion by πN times E_w/H after N periods: what a run has spent is

    m + π ∫ m dN .

What is allowed, A, leaves room for the periods to come: π ∫ m dN will be A in each, if m is half of
A at the turns of a vibration, as cells freeze, and 2/π of that in the mean over time. It is below
what is left whatever comes, so that the budget holds; a wrong guess only spends it early or late.
The budget is half of what time integration and earlier bodies have left when something freezes.

m is a part of what the structure deflects, D (`rigidfx.decide.memory.deflection`), as rigidity
takes nothing from a rigid motion. So the motion is off by m D, and with U the displacement that
the user's budget is a part of, m D/U of the budget is spent. Where D is less than U, as in what
flies, m itself has to be within the budget nevertheless: one per cent of a flight may be all of its
vibration.

Cells freeze in the order of what they would withhold, until half of what is allowed is used; as
much as is above it wakes, the largest contributions first. While loads rest a flexible cell would
withhold the strain that it has swung by in a window; while they change that is no more to be
relied on, and it is its largest strain rate times τ = sqrt(Σ w S²/Σ w P²), P the largest rates so
far: 1/ω where all vibrates with ω. What a body does withhold its shadow tells. It tells too much
where the neighbours are stiffer than the body, for they push a rigid one harder than one that
gives way. So what a cell has swung by stands for what the shadow says while loads rest, unless
that is more than four times as much: where vibration goes from part to part. And of what steady
forces would strain no more counts than twice what the shadow has swung by itself: a part with a
mode that is slower than the motion never gets there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi, sqrt

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.decide.criteria.concentration import stiffness
from rigidfx.decide.criteria.observation import Observation
from rigidfx.decide.criteria.rule import Waking
from rigidfx.decide.memory.memory import Memory
from rigidfx.decide.memory.rise import Rise
from rigidfx.decide.memory.swings import Swings
from rigidfx.effects import Rigid
from rigidfx.report.ledger import Rigidity
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline
from rigidfx.shadow.motion import Limits, Strained

__all__ = ["BudgetRule", "believed", "level"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

OF_RIGIDITY = 0.5  # of what is left of the budget as something becomes rigid
HALF = 0.5  # of what is allowed, that freezing may use, and that waking leaves
MEAN = 2 / pi  # of a vibration's size over time, over what it is at its turns
MARGIN = 1.25  # a window in halves of a period, 2π τ
FEWEST = 8  # steps of a window
PER_OCTAVE, OCTAVES = 4, 400  # levels between which contributions are told apart
AMPLIFIED = 2.0  # what rigidity does to a motion under loads that change, over m
TINY = 1e-200  # strain that is none: where nothing is allowed, all that strains is too much
RINGING = 1.5  # times what loads at rest would withhold, above which shadows ring
OVERSHOOT = 2.0  # times what loads at rest would strain is how far a part swings that they set off
PUSHED = 4.0  # times what cells strain, that their shadow may tell beside stiffer neighbours
# Of m over what is allowed, how close waking is: half of that is meant to be used, and a cell alone
# changes little of a sum.
CALM = 0.25
GROWN = 2.8  # times what strains were, by which a motion begins: as t^1.5
LEFT = 0.1  # of the budget, that is time integration's whatever bodies have spent
EACH = 4  # steps in which the deflection is measured: it takes .3 ms, half of what is observed
STEPS_AT_REST = 2  # in which loads have not changed where motions are free


@dataclass
class Past:
    """What is remembered of owned cells, and of the run.

    Attributes:
        strains: Largest strains so far.
        swings: How far strains have swung in the window.
        seen: What cells of bodies were expected to withhold when they froze; infinite of others
            that have not been observed for a window.
        sums: Σ w ε² and Σ w ε̇² of flexible cells, integrated over time [J s, J/s].
        period: 2π τ [s]; NaN while nothing but rounding has strained.
        whole: Σ w S², over all ranks [J].
        rise: How sqrt(Σ w S²) has grown, on all ranks.
        now: m.
        phase: π ∫ m dN.
        free: Whether loads rest.
        rings: Whether shadows swing by more than loads at rest would strain them.
        t: Time [s].
        rigid: Whether anything is rigid.
        budget: What rigidity may spend; while nothing is rigid, if something were now.
        scale: D/U.
    """

    strains: Array
    swings: Swings
    seen: Array
    sums: Array
    budget: float
    rise: Rise = field(default_factory=lambda: Rise(MPI.COMM_SELF))
    period: float = np.nan
    whole: float = 0.0
    now: float = 0.0
    phase: float = 0.0
    free: bool = False
    rings: bool = False
    t: float = 0.0
    rigid: bool = False
    scale: float = 1.0


class BudgetRule:
    """Cells are quiet as long as all that they would withhold is in the budget."""

    def __init__(self, scene: Scene, timeline: Timeline, memory: Memory, budget: float) -> None:
        """Nothing has strained. Collective.

        Args:
            scene: The problem.
            timeline: Where steps end.
            memory: What the policy remembers.
            budget: Part of the largest displacement that rigidity and time integration may spend.
        """
        self._scene, self._timeline, self._memory, self._whole = scene, timeline, memory, budget
        self._stiffness = stiffness(scene)
        cells = self._stiffness.size
        self._weights: Array = np.zeros(cells)
        named = [scene.owned_cells(part.where, "Rigid").size for part in scene.named(Rigid)]
        self._sizes = [int(size) for size in scene.sum(np.array(named, dtype=float))]
        self.past = Past(
            np.zeros(cells),
            Swings(cells),
            np.full(cells, np.inf),
            np.zeros(2),
            OF_RIGIDITY * budget,
        )
        self._tol: Array = np.zeros(cells)
        self._limit = np.inf

    @property
    def tol(self) -> Array:
        """Strain rate up to which each owned cell was quiet at the end of the last window [1/s]."""
        return self._tol

    @property
    def allowed(self) -> float:
        """What m may be now: freezing up to half of it to the end would spend the budget."""
        past, left = self.past, self.past.budget - self.past.phase
        if not past.free or np.isnan(past.period):
            return max(left, 0.0) / AMPLIFIED
        periods = max(self._timeline.t_end - past.t, 0.0) / past.period
        return max(left, 0.0) / (1 + pi * HALF * MEAN * periods)

    @property
    def rigidity(self) -> Rigidity:
        """What bodies do to the motion."""
        past = self.past
        kept = past.scale * (past.budget if past.rigid else past.phase)
        motion, rest = past.scale * (past.now + past.phase), max(self._whole - kept, self._least)
        return Rigidity(
            motion=motion,
            allowed=self._whole - rest,
            rest=rest,
            withheld=self.allowed,
            free=past.free,
            rings=past.rings,
        )

    @property
    def _least(self) -> float:
        """What is time integration's in any case."""
        return LEFT * self._whole

    def limits(self) -> Limits:
        """Strains that use up what is allowed, or more, if all cells of bodies have them.

        Collective; `waking` is told strains over these.
        """
        rigid = self._memory.back_off.rigid
        w, S = self._weights[rigid], self.past.strains[rigid]
        one, both = self._scene.sum(np.array([w.sum(), (w * S).sum()]))
        room = self.allowed * self.past.whole
        strain = HALF * min(room / both, np.sqrt(room / one)) if both > 0 else np.inf
        self._limit = strain = max(float(strain), TINY)
        each, window = np.full(self._tol.size, strain), self.length()
        return Limits(
            rates=None,
            strains=each,
            window=np.inf if np.isnan(window) else window,
            swings=each,
            reached=CALM * self.past.now / self.allowed if self.allowed > 0 else np.inf,
        )

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known."""
        if self._memory.window.steps < FEWEST:
            return np.nan
        return MARGIN * self.past.period / 2

    def observe(self, seen: Observation) -> None:
        """Remember the largest strains and rates; what rigidity costs goes on. Collective."""
        past, indicator = self.past, seen.indicator
        self._weights = self._stiffness * indicator.weights
        w, now, noise = self._weights, seen.strains, seen.noise
        np.maximum(past.strains, now, out=past.strains)
        past.swings.add(indicator.cells, now)
        local = [w @ past.strains**2, w @ now**2, w @ indicator.values**2, w.sum()]
        past.whole, strain, rate, one = map(float, self._scene.sum(np.array(local)))
        past.rise.add(sqrt(past.whole), seen.t - seen.dt, seen.t)
        past.sums += np.array([strain, rate]) * seen.dt * (rate > one * (10 * noise) ** 2)
        past.period = 2 * pi * np.sqrt(past.sums[0] / past.sums[1]) if past.sums[1] > 0 else np.nan
        past.rigid = sum(body.size for body in seen.bodies) > self._named(seen)
        if not past.rigid:
            past.now = 0.0
        past.free = seen.t - self._memory.loads.resting_since > STEPS_AT_REST * seen.dt
        if past.free and past.now > 0:
            past.phase += pi * past.now * (seen.t - past.t) / past.period
        self._share(seen)
        past.t = seen.t

    def _named(self, seen: Observation) -> int:
        """Number of cells in bodies that users have named rigid, which are none of the budget."""
        held = seen.state.clamped
        return sum(size for k, size in enumerate(self._sizes, start=1) if k not in held)

    def _share(self, seen: Observation) -> None:
        """Divide what is left of the budget. Collective."""
        past, control, deflection = self.past, seen.stepper.control, self._memory.bends.deflection
        assert control is not None  # an `Accuracy` has one
        if self._memory.window.steps % EACH == 1:
            deflection.follow(seen.state, seen.held)
            past.scale = deflection.largest / control.length.displacement
        widest = max(past.scale, 1.0)
        if past.rigid:
            past.budget = min(past.budget, (self._whole - self._least) / widest)
        else:  # time integration spends what there is
            left = (self._whole - control.length.used) / widest - past.phase
            past.budget = past.phase + OF_RIGIDITY * max(left, 0.0)

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Find the tolerances with which half of what is allowed is used. Collective."""
        past, w, worst = self.past, self._weights, self._memory.window.worst
        begins = past.rise.growth(self._memory.window.start, seen.t) > GROWN
        swing, fast = past.swings.end(), worst * past.period / (2 * pi)
        s = swing if past.free else fast
        expected = np.where(flexible, np.maximum(s, swing), np.inf)
        past.seen = np.where(self._memory.back_off.rigid, past.seen, expected)
        density = np.where(flexible, self._stiffness * np.maximum(past.strains, s) * s, 0.0)
        share = density * w / self._stiffness
        room = (HALF * self.allowed - past.now) * past.whole
        most = 0.0 if begins else level(density, share, room, self._scene)
        # Zero where strains are too small to be squared.
        self._tol = np.divide(worst * most, density, out=np.zeros_like(worst), where=density > 0)

    def told(self) -> str:
        """What a user would set by hand to have the same. Collective."""
        some = self._tol[self._tol > 0]
        ends = np.array([some.min(initial=np.inf), -some.max(initial=0.0)])
        self._scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
        if not np.isfinite(ends[0]):
            return "nothing was observed for long enough to become rigid"
        window = MARGIN * self.past.period / 2
        return (
            f"StrainRate with tol from {ends[0]:.3g} to {-ends[1]:.3g} 1/s, by cell, "
            f"window={window:.3g}, wake='local', kappa={1 / HALF:g} did the same at last"
        )

    def waking(self, strained: Strained, free: Bools) -> Waking:
        """What is above the budget wakes, the largest contributions first. Collective."""
        past, w, nothing = self.past, self._weights, np.zeros(free.size, dtype=bool)
        if not np.isfinite(self._limit):
            return Waking(nothing, nothing)
        assert strained.swing is not None
        swing = strained.swing * self._limit
        still = np.minimum(strained.sum * self._limit, OVERSHOOT * swing)
        s: Array = np.where(free, np.maximum(still, swing), 0.0)
        if past.free:
            s = believed(s, past.seen)
        S = np.maximum(past.strains, s)
        share = w * S * s
        slow = w * np.maximum(past.strains, still) * np.where(free, np.minimum(still, s), 0.0)
        total, whole, steady = self._scene.sum(
            np.array([share.sum(), (w * S**2).sum(), slow.sum()])
        )
        past.rings = bool(total > RINGING * steady)
        past.now = float(total / whole) if whole > 0 else 0.0
        if past.now <= self.allowed:
            return Waking(nothing, nothing)
        density = self._stiffness * S * s
        most = level(density, share, HALF * self.allowed * whole, self._scene)
        cells = (density >= most) & (s > 0)
        return Waking(cells, cells & (still >= swing))


def believed(told: Array, seen: Array) -> Array:
    """Strains that cells of bodies withhold while loads rest.

    Args:
        told: By their shadow.
        seen: What they had swung by when they froze.
    """
    return np.maximum(np.minimum(told, seen), told / PUSHED)


def level(density: Array, share: Array, room: float, scene: Scene) -> float:
    """The density below which cells' shares add up to what there is room for. Collective.

    Args:
        density: Of each owned cell, ≥ 0.
        share: Of each owned cell.
        room: In the unit of the shares.
        scene: The problem.
    """
    if room <= 0:
        return 0.0
    some = density > 0
    number = np.floor(PER_OCTAVE * np.log2(density[some])).astype(np.int64)
    bins = 2 * PER_OCTAVE * OCTAVES
    place = np.clip(number + bins // 2, 0, bins - 1)
    sums = np.asarray(scene.sum(np.bincount(place, share[some], bins)))
    k = int(np.searchsorted(np.cumsum(sums), room, side="right"))
    return float(2.0 ** ((k - bins // 2) / PER_OCTAVE))

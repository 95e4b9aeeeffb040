"""The rule of `Accuracy`: the displacement that bodies lack stays within a budget.

docs/theory/waking.md#by-a-budget says how much shapes may lack (`rigidfx.growth.growth`), and m,
(5), the displacement that a freeze of woken cells would lose, by their largest strains so far, S,
and strains s that are withheld.
"""

from math import inf, isnan, nan, pi, sqrt
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_CELLS, Remembered, same
from rigidfx.base.types import Array, Bools
from rigidfx.decide.limits import Limits
from rigidfx.decide.memory import Memory
from rigidfx.decide.rules import FEWEST, MARGIN, Observation
from rigidfx.effects import InitialDisplacement
from rigidfx.report.ledger import Rigidity
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import Timeline

PER_OCTAVE, OCTAVES = 4, 400  # levels between which contributions are told apart
TO_BODIES = 0.5  # part of the budget that time integration has left, that rigid parts may spend
# Part of that which freezes use, and which time integration leaves to them in any case. A part that
# vibrated on took two to seven times m; at 0.5 an arm of 20 073 unknowns was released
# repeatedly.
FREEZING = 0.2
AMPLIFIED = 2.0  # amplification of m by loads that change
AT_REST = 2  # steps in which loads have not changed where motions are free


class BudgetRule:
    """Cells are quiet if a freeze of all of them would stay within the budget.

    Attributes:
        tol: Strain rate up to which each owned cell was quiet at the end of the last window [1/s].
    """

    remembered: ClassVar[Remembered] = same(
        "_sums",
        "_period",
        "_energy",
        "_free",
        "_t",
        "_budget",
        "_size",
        "_largest",
        "_frozen",
        "_begins",
        "_from_rest",
    ) | dict.fromkeys(("tol", "_strains", "_weights", "_low", "_high"), ON_CELLS)

    def __init__(self, scene: Scene, timeline: Timeline, memory: Memory, budget: float) -> None:
        """Nothing has strained. Collective.

        Rigidity and time integration may spend the budget, part of the largest displacement.
        """
        self._begins = not scene.named(InitialDisplacement)  # all cells are quiet at first
        self._scene, self._timeline, self._memory, self._whole = scene, timeline, memory, budget
        self._stiffness = stiffness(scene)
        cells = self._stiffness.size
        self._strains: Array = np.zeros(cells)  # largest so far
        # The least and the most of the window. Strains are magnitudes, so that the swing of a
        # vibration about zero is its amplitude, about a larger strain twice its amplitude.
        self._low, self._high = np.full(cells, inf), np.full(cells, -inf)
        self._sums: Array = np.zeros(2)  # Σ w ε² and Σ w ε̇², integrated over time [J s, J/s]
        self._weights: Array = np.zeros(cells)
        self._period, self._energy = nan, 0.0  # 2π τ [s]; Σ w S² [J]
        self._free, self._t = False, 0.0
        self._budget = TO_BODIES * budget  # what rigidity may spend, as it stands
        self._size, self._largest = 0.0, 0.0  # what bodies lack, and U [m]
        self._from_rest = False  # whether a motion begins
        self._frozen = False  # whether there are bodies that were found
        self.tol: Array = np.zeros(cells)

    # What is allowed ----------------------------------------------------------------------------

    @property
    def _lost(self) -> float:
        """Part of the deflection that a freeze may take: m."""
        if not self._largest > 0:
            return 0.0
        room = max(FREEZING * self._budget - self._motion, 0.0)
        if not self._free or isnan(self._period):
            return room / AMPLIFIED
        return room / (1 + pi * max(self._timeline.t_end - self._t, 0.0) / self._period)

    @property
    def _motion(self) -> float:
        """Error of the motion by bodies so far, over the largest displacement."""
        return self._size / self._largest if self._largest > 0 else 0.0

    @property
    def _kept(self) -> float:
        """Part of the largest displacement that time integration leaves to bodies."""
        most = TO_BODIES * self._whole
        if self._frozen and self._from_rest:  # what bodies will lack is not known yet
            return most
        least = FREEZING * most if self._frozen else 0.0
        return min(max(self._motion, least), most)

    @property
    def rigidity(self) -> Rigidity:
        """Error of the motion by bodies."""
        return Rigidity(self._motion, self._kept, self._whole - self._kept, self._lost)

    def limits(self) -> Limits:
        """The displacement that bodies may lack."""
        return Limits(part=self._budget, begins=self._from_rest)

    def length(self) -> float:
        """How long a window is to be [s]; NaN while that is not known."""
        if self._begins:
            return 0.0
        return nan if self._memory.window.steps < FEWEST else MARGIN * self._period / 2

    # What is seen -------------------------------------------------------------------------------

    def observe(self, seen: Observation) -> None:
        """Remember the largest strains and rates, and the unspent budget. Collective."""
        indicator, control = seen.indicator, seen.stepper.control
        assert control is not None  # an `Accuracy` has one
        self._weights = w = self._stiffness * indicator.weights
        now, cells = indicator.strains(), indicator.cells
        np.maximum(self._strains, now, out=self._strains)
        self._low[cells] = np.minimum(self._low[cells], now[cells])
        self._high[cells] = np.maximum(self._high[cells], now[cells])
        local = [w @ self._strains**2, w @ now**2, w @ indicator.values**2, w.sum()]
        self._energy, strain, rate, one = map(float, self._scene.sum(np.array(local)))
        self._sums += np.array([strain, rate]) * seen.dt * (rate > one * (10 * seen.noise) ** 2)
        if self._sums[1] > 0:
            self._period = 2 * pi * sqrt(self._sums[0] / self._sums[1])
        rested = seen.t - self._memory.loads.resting_since
        self._free = rested > AT_REST * seen.dt
        self._size = seen.error
        self._largest, self._t = control.length.displacement, seen.t
        self._from_rest = control.length.begins(seen.t)
        self._frozen = any(not body.named and not body.is_face for body in seen.bodies)
        left = max(self._whole - control.length.used, 0.0)
        self._budget = max(TO_BODIES * left, self._kept)

    def window_ends(self, seen: Observation, flexible: Bools) -> None:
        """Find the tolerances that use the allowed value. Collective."""
        if self._begins:
            self._begins = False
            self.tol = np.full(flexible.size, inf)
            return
        worst, swing = self._memory.window.worst, np.maximum(self._high - self._low, 0.0)
        self._low[:], self._high[:] = inf, -inf
        s = swing if self._free else worst * self._period / (2 * pi)
        density = np.where(flexible, self._stiffness * np.maximum(self._strains, s) * s, 0.0)
        share = density * self._weights / self._stiffness
        most = level(density, share, self._lost * self._energy, self._scene)
        # Zero where strains are too small to be squared.
        self.tol = np.divide(worst * most, density, out=np.zeros_like(worst), where=density > 0)


def stiffness(scene: Scene) -> Array:
    """The stiffest parameter of the material of each owned cell [Pa]. Collective."""
    out = np.ones(scene.owned_cells(None, "").size)
    for material, cells in scene.materials:
        out[cells] = max(map(abs, material.parameters.values()), default=1.0)
    return out


def level(density: Array, share: Array, room: float, scene: Scene) -> float:
    """The density below which shares of owned cells add up to the room. Collective."""
    if room <= 0:
        return 0.0
    some = density > 0
    number = np.floor(PER_OCTAVE * np.log2(density[some])).astype(np.int64)
    bins = 2 * PER_OCTAVE * OCTAVES
    place = np.clip(number + bins // 2, 0, bins - 1)
    sums = np.asarray(scene.sum(np.bincount(place, share[some], bins)))
    k = int(np.searchsorted(np.cumsum(sums), room, side="right"))
    return float(2.0 ** ((k - bins // 2) / PER_OCTAVE))

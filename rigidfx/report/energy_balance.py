"""Has a run kept its balance of energy?

The energy-momentum method keeps it to Newton's tolerance whatever happens, so a run that has lost
it has lost more than that: the rounding of parts that are stiff beyond measure, or a tolerance set
so loose that what is left of the residual does work. Nothing else in a report would tell.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import StepError
from rigidfx.base.remembered import Remembered, same
from rigidfx.report.advice import ADVICE, Adviser
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

OFF, LOST = "the balance of energy is off", "the balance of energy is lost"  # rows of advice
ROUNDED = "rounding dominates energies"
LARGE = ADVICE[ROUNDED].bound
TINY = float(np.finfo(np.float64).tiny)
EPS = float(np.finfo(np.float64).eps)
ROUNDING = 1e3 * EPS  # of numbers near one that energies are made of


class EnergyBalance(Adviser):
    """Follows the energy of a run and the energy supplied to it."""

    remembered: ClassVar[Remembered] = Adviser.remembered | same(
        "_expected", "_scale", "_known", "_held", "_most", "_given", "_lost", "_switched"
    )

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report; schemes that do not conserve energy are not followed."""
        super().__init__(scene)
        self._expected = self._scale = self._known = 0.0
        self._rounding = _rounding(scene)
        self._held, self._size = 0.0, scene.mean_cell_size
        self._follows = scene.scheme.conserving
        self._most = 0.0  # largest error of the balance so far [J]
        self._given = 0.0  # most that a run has begun with, or that work has brought [J]
        self._lost = ""  # when, and how much of it, once it is lost
        self._switched = 0.0  # how far bodies have changed it as they began and ended [J]

    def follow(self, report: Report) -> None:
        """Add the next report, that of the initial state first."""
        if not self._follows or self._lost:
            return
        work = report.work_of_loads + report.work_of_supports
        taken = sum(report.dissipated.values())
        self._given = max(self._given, abs(work))
        if report.step == 0:
            self._expected, self._given = report.energy, report.kinetic
        else:
            self._expected += report.supplied
        # What joints hold at rest moves by rounding, and their forces with it.
        self._held += ROUNDING * report.joints.total * self._size
        self._known = max(self._known, abs(self._expected), abs(work), taken)
        self._scale = max(self._scale, report.energy, abs(work), taken)
        off = max(0.0, abs(report.energy - self._expected) - self._held)
        self._switched += sum(abs(event.energy_lost) for event in report.events)
        rounding = self._rounding
        self._most = max(self._most, off)
        beyond_rounding = off > ADVICE[OFF].bound * self._scale + rounding.all
        large = beyond_rounding or off > LARGE * self._scale + rounding.softest
        if large and OFF not in self.said:
            why = (
                "Rounding in parts that are very stiff or very light for their stiffness may be "
                "why: make these Rigid, or take less extreme numbers. If -rigidfx_snes_rtol is "
                "set, make it smaller."
            )
            why = why if beyond_rounding else rounding.why
            if 2 * self._switched > off:
                why = (
                    f"Bodies that were released have changed it by {self._switched:.1e} J: their "
                    "cells had another strain energy than shapes, and no velocities to take the "
                    "difference from. Take a smaller Δt or tolerance, or let them stay flexible."
                )
            self.advise(OFF, t=report.t, number=off / self._scale, why=why)
        if off > ADVICE[LOST].bound * self._known + rounding.softest:
            self._lost = (
                f"At t = {report.t:.6g} s the energy was {report.energy:.3g} J where "
                f"{self._expected:.3g} J are accounted for"
            )
            self.advise(LOST, lost=self._lost)

    def end(self) -> None:
        """Say at the end of a run whether its energies were rounding; before, they might grow."""
        at_rest = self._given <= LARGE * self._rounding.known
        if self.said or at_rest or self._most <= LARGE * self._scale:
            return
        largest, part = self._scale, self._most / self._scale
        self.advise(ROUNDED, number=part, largest=largest, known=self._rounding.known)

    def explained(self, error: StepError) -> StepError:
        """The error with other advice, if the balance was lost before."""
        if not self._lost:
            return error
        return type(error)(error.found, f"{self._lost}: look for the cause of that first.")


@dataclass(frozen=True)
class _Rounding:
    """Rounding that may be left in the strain energy of a scene whatever moves."""

    all: float  # with its materials as they are [J]
    # If all were like the one whose energy is known best [J]: any difference within that is
    # rounding
    softest: float
    known: float  # machine precision times the stiffest material's energy [J]
    why: str  # for a warning where the stiffest material alone is to blame


def _rounding(scene: Scene) -> _Rounding:
    """Size of rounding. Collective.

    An energy like neo-Hooke's, tr C - 3 - ln det C, is the small difference of numbers near one, so
    that it is known to ε E V only; one that is quadratic in the strain, to ε² E V at least. Parts
    named rigid have none.
    """
    named: list[Any] = [effect for effect in scene.effects if effect.is_rigid]
    bodies = [scene.owned_cells(effect.where, effect.kind) for effect in named]
    rigid = np.concatenate([np.empty(0, np.int32), *bodies])
    counts = scene.sum([np.setdiff1d(cells, rigid).size for _, cells in scene.materials])
    size = scene.mean_cell_size**3
    materials = [material for (material, _), n in zip(scene.materials, counts, strict=True) if n]
    if not materials:
        return _Rounding(0.0, 0.0, 0.0, "")
    volumes = counts[counts > 0] * size
    stiffness = np.array([material.stiffness for material in materials])
    densities = stiffness * [ROUNDING**2 if m.quadratic else ROUNDING for m in materials]
    worst = int(np.argmax(densities * volumes))
    known = EPS * stiffness[worst] * volumes[worst]
    why = (
        f"The energy of {type(materials[worst]).__name__}, a small difference of numbers near one "
        f"times up to {stiffness[worst]:.1e} Pa, is known to some {known:.1e} J only, whatever the "
        f"step and the tolerances, and softer parts share it: a ratio of stiffness of "
        f"{stiffness[worst] / max(stiffness.min(), TINY):.0e} is too much for so little "
        "energy. Make that part Rigid, or StVenantKirchhoff, or its stiffness smaller."
    )
    softest = float(densities.min() * volumes.sum())
    return _Rounding(float(densities @ volumes), softest, float(known), why)

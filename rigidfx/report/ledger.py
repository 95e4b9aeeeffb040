"""What a run has spent of accuracy so far, and on what: four accounts that are never added up.

    withheld   strain energy that rigidity withholds now, ½ ρᵀK⁺ρ                     [J]
    frozen     kinetic energy of vibration that bodies keep for their release now    [J]
    time       estimated error of displacements by time integration, added up        [m]
    damping    energy that numerical damping has taken so far                         [J]

Energies are relative to the largest energy of deformation so far (`rigidfx.step.deformation`),
errors of displacements to the largest displacement so far of what is watched. The error of the mesh
is not estimated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isnan, nan, pi
from typing import ClassVar

from rigidfx.effects import NumericalDamping
from rigidfx.step.deformation import Deformation
from rigidfx.step.energies import Measures
from rigidfx.step.stepper import Stepper

__all__ = ["Entry", "Ledger", "Ledgers"]

TINY = 1e-300


@dataclass(frozen=True)
class Entry:
    """One account.

    Attributes:
        spent: What has been spent, in its unit; NaN where nothing estimates it.
        scale: What it is relative to, in the same unit.
        allowed: What was allowed, in the same unit; NaN where nothing was asked.
        unit: "J" or "m".
    """

    spent: float
    scale: float
    allowed: float
    unit: str

    @property
    def relative(self) -> float:
        """What has been spent, over the scale; zero where nothing has been."""
        return 0.0 if self.spent == 0 else self.spent / max(self.scale, TINY)

    def __str__(self) -> str:
        """In words."""
        if isnan(self.spent):
            return "not estimated"
        allowed = "" if isnan(self.allowed) else f" of {self.allowed:.3g} {self.unit} allowed"
        return f"{self.spent:.3g} {self.unit}{allowed}, {self.relative:.2%}"


@dataclass(frozen=True)
class Ledger:
    """What a run has spent at the end of a step; equal on all ranks.

    Attributes:
        withheld: Strain energy that rigidity withholds now.
        frozen: Kinetic energy of vibration that bodies keep now.
        time: Error of displacements by time integration so far, an estimate.
        damping: Energy taken by numerical damping so far.
        periods: Periods N that the motion has gone through so far, as far as can be told.
        rejected: Steps that were repeated so far, as they erred by too much in time.
    """

    MESH: ClassVar[str] = "not estimated: compare with a finer mesh"

    withheld: Entry
    frozen: Entry
    time: Entry
    damping: Entry
    periods: float
    rejected: int

    @property
    def motion(self) -> float:
        """Relative error of the motion that rigidity makes, (1 + πN) E_w/H: an estimate.

        It holds for loads slower than the bodies (Rayleigh: a frequency is off by E_w/2H); near a
        resonance nothing bounds the error.
        """
        return (1 + pi * self.periods) * self.withheld.relative

    def __str__(self) -> str:
        """All accounts, one per line."""
        names = {
            "withheld": "withheld by rigidity",
            "frozen": "frozen vibration",
            "time": "time integration",
            "damping": "numerical damping",
        }
        lines = [f"{words:21s} {getattr(self, name)}" for name, words in names.items()]
        return "\n".join([*lines, f"{'mesh':21s} {self.MESH}"])


class Ledgers:
    """Keeps the accounts of a run."""

    def __init__(self, stepper: Stepper, budget: float = nan) -> None:
        """Nothing has been spent. Collective.

        Args:
            stepper: Makes the steps.
            budget: What energies may be spent, over that of deformation; NaN if nothing says.
        """
        self._stepper, self._budget = stepper, budget
        self._deformation = Deformation(stepper.scene)
        self._damped = 0.0

    @property
    def deformation(self) -> float:
        """Largest energy of deformation so far [J]."""
        return self._deformation.largest

    def follow(
        self, measures: Measures, taken: Mapping[str, float], withheld: float, periods: float
    ) -> Ledger:
        """The ledger after a step. Collective.

        Args:
            measures: Energies at its end.
            taken: Energy that each kind of damping took in it [J].
            withheld: Strain energy that rigidity withholds [J]; NaN if nothing estimates it.
            periods: Periods so far.
        """
        stepper = self._stepper
        self._deformation.measure(stepper.system, stepper.state, measures)
        self._damped += taken.get(NumericalDamping.__name__, 0.0)
        H = self._deformation.largest
        frozen = sum(max(b.frozen.vibration, 0.0) for b in stepper.state.bodies.of.records)
        allowed = self._budget * H
        return Ledger(
            withheld=Entry(withheld, H, allowed / (1 + pi * periods), "J"),
            frozen=Entry(frozen, H, allowed, "J"),
            time=self._time(),
            damping=Entry(self._damped, H, allowed, "J"),
            periods=periods,
            rejected=0 if stepper.control is None else stepper.control.rejected,
        )

    def _time(self) -> Entry:
        control = self._stepper.control
        if control is None:
            return Entry(nan, nan, nan, "m")
        length = control.length
        return Entry(length.spent, length.displacement, control.tol * length.displacement, "m")

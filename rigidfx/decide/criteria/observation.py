"""The run as a policy sees it; it changes none of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.flexible.indicator import Indicator
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.state import State
from rigidfx.step.stepper import Stepper

__all__ = ["Observation"]


@dataclass(frozen=True)
class Observation:
    """The run around a step.

    Attributes:
        stepper: What makes the steps.
        dt: Length of the step [s].
        stiffening: What bodies withhold over the strain of their own cells, in energies; None if
            that is not known.
        energies: Kinetic and strain energy of deformation after the step before [J]; None if nobody
            measures them.
        withheld: Strain energy that rigidity withholds [J]; 0 if nothing estimates it.
        share: What part of that a part named rigid withholds in the whole structure, by its name;
            None if nothing estimates it. Collective.
        shared: Strain rate of each owned cell by u + e [1/s]; None where that is not measured.
    """

    stepper: Stepper
    dt: float
    stiffening: float | None = None
    energies: tuple[float, float] | None = None
    withheld: float = 0.0
    share: Callable[[str], float] | None = None
    shared: npt.NDArray[np.float64] | None = None

    @property
    def t(self) -> float:
        """Time [s]."""
        return self.stepper.state.t

    @property
    def state(self) -> State:
        """The state."""
        return self.stepper.state

    @property
    def bodies(self) -> tuple[RigidBody, ...]:
        """Data of the rigid bodies."""
        return self.stepper.state.bodies.of.records

    @property
    def flies_rigid(self) -> bool:
        """Whether all there is is one rigid body that nothing holds: it deflects no more."""
        if len(self.bodies) != 1 or self.stepper.unknowns != 6:
            return False
        return not any(effect.holds for effect in self.stepper.scene.effects)

    @property
    def flexible(self) -> npt.NDArray[np.bool_]:
        """For each owned cell, whether it is flexible."""
        return self.stepper.flexible

    @property
    def supported(self) -> npt.NDArray[np.bool_]:
        """For each owned node, whether a support holds any of its components."""
        return self.stepper.supported_nodes

    @property
    def held(self) -> npt.NDArray[np.bool_]:
        """For each owned dof, whether a support prescribes it."""
        return self.stepper.prescribed.mask

    @property
    def indicator(self) -> Indicator:
        """The measure of cells in the last step."""
        assert self.stepper.indicator is not None  # a run that decides measures
        return self.stepper.indicator

    @property
    def rates(self) -> npt.NDArray[np.float64]:
        """Strain rate of each owned cell, zero in bodies [1/s]: by u + e, if that is measured."""
        return self.indicator.values if self.shared is None else self.shared

    @property
    def strains(self) -> npt.NDArray[np.float64]:
        """Strain of each owned cell, zero in bodies."""
        return self.indicator.strains()

    @property
    def noise(self) -> float:
        """Strain rate that the end of Newton's iteration may leave in a cell [1/s]. Collective."""
        return self.stepper.strain_error / self.dt

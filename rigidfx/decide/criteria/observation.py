"""The run as a policy sees it; it changes none of it."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.types import Array, Bools
from rigidfx.error.error_motion import ErrorMotion
from rigidfx.flexible.indicator import Indicator
from rigidfx.mechanics.rigid_body import RigidBody
from rigidfx.state import State
from rigidfx.step.stepper import Stepper

__all__ = ["Observation"]


@dataclass(frozen=True)
class Observation:
    """The run around a step.

    Attributes:
        stepper: The stepper.
        dt: Length of the step [s].
        shared: Strain rate of each owned cell by u + e [1/s]; None where that is not measured.
        motion: The error motion; None if it is not followed.
    """

    stepper: Stepper
    dt: float
    shared: Array | None = None
    motion: ErrorMotion | None = None

    @property
    def error(self) -> tuple[float, bool]:
        """Largest |e| of any node [m], and whether e is added to the results shown. Collective."""
        return (0.0, False) if self.motion is None else (self.motion.size(), self.motion.all_shown)

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
    def flexible(self) -> Bools:
        """For each owned cell, whether it is flexible."""
        return self.stepper.flexible

    @property
    def supported(self) -> Bools:
        """For each owned node, whether a support holds any of its components."""
        return self.stepper.supported_nodes

    @property
    def held(self) -> Bools:
        """For each owned dof, whether a support prescribes it."""
        return self.stepper.prescribed.mask

    @property
    def indicator(self) -> Indicator:
        """The measure of cells in the last step."""
        assert self.stepper.indicator is not None  # a run that decides measures
        return self.stepper.indicator

    @property
    def rates(self) -> Array:
        """Strain rate of each owned cell, zero in bodies [1/s]: by u + e, if that is measured."""
        return self.indicator.values if self.shared is None else self.shared

    @property
    def strains(self) -> Array:
        """Strain of each owned cell, zero in bodies."""
        return self.indicator.strains()

    @property
    def noise(self) -> float:
        """Strain rate that the end of Newton's iteration may leave in a cell [1/s]. Collective."""
        return self.stepper.strain_error / self.dt

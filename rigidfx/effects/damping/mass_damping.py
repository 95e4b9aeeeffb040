"""Drag proportional to mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rigidfx.base.inputs import positive
from rigidfx.effects.action import Action, Structure
from rigidfx.effects.base import Windowed
from rigidfx.effects.inertia import Inertia
from rigidfx.effects.motion import Motion, Tangent

__all__ = ["MassDamping"]


@dataclass(frozen=True)
class MassDamping(Windowed):
    """Drag proportional to mass: the force -α M Δu/Δt, on flexible nodes and on rigid bodies.

    It damps rigid motion too, as a surrounding fluid would; a mode of angular frequency ω gets the
    damping ratio α/(2 ω). The ends of its window release no rigid body.

    Attributes:
        alpha: α > 0 [1/s].
    """

    alpha: float

    def __post_init__(self) -> None:
        """Check α.

        Raises:
            SceneError: If α is not a finite number > 0.
        """
        super().__post_init__()
        positive("MassDamping", "alpha", self.alpha)

    @property
    def mass_damping(self) -> float:
        """α [1/s]."""
        return float(self.alpha)

    def bind(self, structure: Structure) -> Action:
        """The drag on nodes and bodies."""
        return Drag(float(self.alpha), structure)


class Drag(Action):
    """The force α M Δu/Δt as a resistance.

    A body has -α m Δr/Δt and -α I_av θ/Δt, I_av = tr(B) I - B with B = R_av (Σ m V Vᵀ) R_avᵀ.
    """

    kind = MassDamping.__name__
    rounding = 0.0  # below that of inertia

    def __init__(self, alpha: float, structure: Structure) -> None:
        """Take the mass over. Collective.

        Args:
            alpha: α [1/s].
            structure: Its nodes and bodies.
        """
        self._alpha, self._inertia = alpha, Inertia(structure)

    def resist(self, motion: Motion, forces: Any) -> None:
        """See `Action`."""
        moved = motion.d, motion.increments.displacement
        self._inertia.add(self._alpha / motion.dt, *moved, forces)

    def stiffen(self, motion: Motion, tangent: Tangent) -> None:
        """See `Action`."""
        self._inertia.stiffen(self._alpha / motion.dt, tangent)

    def taken(self, motion: Motion) -> float:
        """α Δu·M Δu/Δt [J]."""
        moved = self._inertia.square(motion.d, motion.increments.displacement)
        return self._alpha / motion.dt * moved

    def destroy(self) -> None:
        """Free the work vectors. Collective."""
        self._inertia.destroy()

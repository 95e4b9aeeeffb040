"""Numerical damping of high frequencies, a parameter of the time integration scheme."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, shown
from rigidfx.effects.base import Windowed

__all__ = ["NumericalDamping"]


@dataclass(frozen=True)
class NumericalDamping(Windowed):
    """High-frequency dissipation of Armero and Petöcz, equation (22): ξ ∫ ΔE:ℂ₀:ΔE dV per step.

    The ends of its window release no rigid body.

    Attributes:
        xi: ξ ≥ 0, dimensionless; the scheme is of first order in Δt where ξ > 0.
    """

    xi: float

    def __post_init__(self) -> None:
        """Check ξ.

        Raises:
            SceneError: If ξ is negative, above ½ or not finite.
        """
        super().__post_init__()
        if not 0 <= number("NumericalDamping", "xi", self.xi) <= 0.5:
            raise SceneError(f"NumericalDamping: xi must lie in [0, 1/2], got {shown(self.xi)}.")

    @property
    def numerical_damping(self) -> float:
        """ξ."""
        return float(self.xi)

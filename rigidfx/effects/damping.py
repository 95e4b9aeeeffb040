"""What takes energy out of the motion: numerical, viscous and mass-proportional damping.

Damping in a time window changes no load and no support: its ends release no rigid body.
"""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive
from rigidfx.effects.base import Windowed

__all__ = ["Damping", "KelvinVoigt", "MassDamping", "NumericalDamping"]


class Damping(Windowed):
    """Any damping."""


@dataclass(frozen=True)
class NumericalDamping(Damping):
    """High-frequency dissipation of Armero and Petöcz, equation (22): ξ ∫ ΔE:ℂ₀:ΔE dV per step.

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
            raise SceneError(f"NumericalDamping: xi must lie in [0, 1/2], got {self.xi!r}.")


@dataclass(frozen=True)
class KelvinVoigt(Damping):
    """Objective viscous stress S = η ΔE/Δt, which takes ∫ η ΔE:ΔE/Δt dV per step.

    It sees strain rates only, so neither rigid motion nor a rigid body is damped. Effects on the
    same cells add up.

    Attributes:
        eta: Viscosity η > 0 [Pa s].
        where: Name of a set of cells; everywhere if None.
    """

    eta: float
    where: str | None = None

    def __post_init__(self) -> None:
        """Check η.

        Raises:
            SceneError: If η is not a finite number > 0.
        """
        super().__post_init__()
        positive("KelvinVoigt", "eta", self.eta)


@dataclass(frozen=True)
class MassDamping(Damping):
    """Drag proportional to mass: the force -α M Δu/Δt, on flexible nodes and on rigid bodies.

    It damps rigid motion too, as a surrounding fluid would; a mode of angular frequency ω gets the
    damping ratio α/(2 ω).

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

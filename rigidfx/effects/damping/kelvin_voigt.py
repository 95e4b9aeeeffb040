"""Viscous damping of strains: a term of the compiled forms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem

from rigidfx.base.inputs import positive
from rigidfx.effects.action import FormTerm
from rigidfx.effects.base import Windowed
from rigidfx.effects.damping.viscous_term import ViscousTerm
from rigidfx.mechanics.element import Element

__all__ = ["KelvinVoigt"]


@dataclass(frozen=True)
class KelvinVoigt(Windowed):
    """Objective viscous stress S = η ΔE/Δt, which takes ∫ η ΔE:ΔE/Δt dV per step.

    It depends on strain rates only, so it damps neither rigid motions nor rigid bodies. Effects on
    the same cells add up.

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

    def check(self, scene: Any) -> None:
        """Look its cells up."""
        scene.owned_cells(self.where, self.kind)

    def term(self, mesh: Any) -> FormTerm:
        """The viscous stress."""
        return ViscousStress(self, mesh)


class ViscousStress(ViscousTerm):
    """S = η ΔE/Δt in the compiled forms."""

    kind = KelvinVoigt.__name__

    def __init__(self, effect: KelvinVoigt, mesh: Any) -> None:
        """Take the viscosity η [Pa s] over."""
        super().__init__(float(effect.eta), fem.Constant(mesh, float(effect.eta)))

    def stress(self, element: Element, u0: Any, u1: Any) -> Any:
        """η ΔE/Δt."""
        return self._rate * element.viscous_strain_increment(u0, u1)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """η/Δt ∂(ΔE)/∂u₁ at F½."""
        return element.viscous_eliminated((u0, u1), u1, self._rate, w, du)

    def taken(self, element: Element, u0: Any, u1: Any) -> Any:
        """η ΔE:ΔE/Δt [J/m³]."""
        dE = element.viscous_strain_increment(u0, u1)
        return self._rate * ufl.inner(dE, dE)

"""Damping in proportion to stiffness, Rayleigh's second part: a term of the compiled forms."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.inputs import positive
from rigidfx.base.warning import warn
from rigidfx.effects.action import FormTerm
from rigidfx.effects.base import Windowed
from rigidfx.effects.damping.viscous_term import ViscousTerm
from rigidfx.mechanics.element import Element
from rigidfx.mechanics.schemes import Law, initial_stiffness_times

__all__ = ["StiffnessDamping", "warn_of_ratio"]


@dataclass(frozen=True)
class StiffnessDamping(Windowed):
    """Viscous stress S = β ℂ₀:ΔE/Δt with β = ζ/(π f), ℂ₀ the material's stiffness when unstrained.

    A linear vibration at the frequency f has the damping ratio ζ; the ratio is proportional to the
    frequency. It damps neither rigid motions nor rigid bodies, and dissipates
    β ∫ ΔE:ℂ₀:ΔE/Δt dV per step. `MassDamping` is the other part of Rayleigh's damping.

    Attributes:
        ratio: Damping ratio ζ > 0 of a vibration, 1 where it is critical.
        frequency: Its frequency f > 0 [Hz].
        where: Name of a set of cells; everywhere if None.
    """

    ratio: float
    frequency: float
    where: str | None = None

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            SceneError: If one is not a finite number > 0.
        """
        super().__post_init__()
        positive(self.kind, "ratio", self.ratio)
        positive(self.kind, "frequency", self.frequency)

    @property
    def beta(self) -> float:
        """β [s]."""
        return float(self.ratio) / (pi * float(self.frequency))

    def check(self, scene: Any) -> None:
        """Look its cells up; warn of a ratio at which nothing vibrates."""
        scene.owned_cells(self.where, self.kind)
        warn_of_ratio(scene.comm, self.owner, self.ratio)

    def term(self, mesh: Any) -> FormTerm:
        """The viscous stress."""
        return ProportionalStress(self.beta, fem.Constant(mesh, self.beta))


def warn_of_ratio(comm: MPI.Intracomm, owner: str, ratio: float) -> None:
    """Warn of a damping ratio above the critical one."""
    if ratio > 1:
        warn(
            comm,
            f"{owner}: the damping ratio {ratio:.3g} is above the critical one, 1, so that nothing "
            "vibrates. Two per cent are 0.02.",
        )


class ProportionalStress(ViscousTerm):
    """S = β ℂ₀:ΔE/Δt in the compiled forms, of one law."""

    kind, law = StiffnessDamping.__name__, "elastic"

    def __init__(self, beta: float, rate: Any, law: Law | None = None) -> None:
        """Take β [s] over, and the constant of the forms that is β/Δt."""
        super().__init__(beta, rate)
        self._law = law

    def of(self, law: Law) -> FormTerm:
        """The stress in cells of a law."""
        return ProportionalStress(self._modulus, self._rate, law)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """β/Δt ∂(ℂ₀:ΔE)/∂u₁ at F½."""
        return element.eliminated((u0, u1), u1, 0.0, self._rate, w, du)

    def taken(self, element: Element, u0: Any, u1: Any) -> Any:
        """β ΔE:ℂ₀:ΔE/Δt [J/m³]."""
        return ufl.inner(self.stress(element, u0, u1), element.strain_increment(u0, u1))

    def stress(self, element: Element, u0: Any, u1: Any) -> Any:
        """β ℂ₀:ΔE/Δt."""
        assert self._law is not None
        dE = element.strain_increment(u0, u1)
        energy, p = self._law.energy, self._law.parameters
        return self._rate * initial_stiffness_times(energy, p, dE)

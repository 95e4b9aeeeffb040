"""Damping: viscous stresses, which are terms of the compiled forms, and ξ of the scheme."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.warning import warn
from rigidfx.effects.action import FormTerm
from rigidfx.effects.base import Windowed
from rigidfx.mechanics.element import Element, Portion
from rigidfx.mechanics.schemes import Law, initial_stiffness_times

__all__ = ["KelvinVoigt", "NumericalDamping", "StiffnessDamping", "warn_of_ratio"]


class ViscousTerm(FormTerm):
    """A stress that is a modulus times a strain increment over Δt."""

    viscous = True
    law: Literal["elastic", "viscous"] = "viscous"  # what the modulus multiplies: see `Portion`

    def __init__(self, modulus: float, rate: Any) -> None:
        """Store the modulus, and the constant of the forms that is modulus/Δt."""
        self._modulus, self._rate = modulus, rate

    def set_time(self, t: float, dt: float) -> None:
        """Set modulus/Δt."""
        self.set_rate(1 / dt)

    def set_rate(self, rate: float) -> None:
        """Set the modulus times a rate [1/s]."""
        self._rate.value = self._modulus * rate

    def stress(self, element: Element, u0: Any, u1: Any) -> Any:
        """S of a step from u₀ to u₁ [Pa]."""
        raise NotImplementedError

    def virtual_work(self, element: Element, u0: Any, u1: Any, w: Any) -> Any:
        """F½ S : Grad w."""
        S, portion = self.stress(element, u0, u1), Portion(self.law, u1, u0, 0.0, self._rate)
        return element.virtual_work(S, (portion,), (u0, u1), w)


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
        """Raise `SceneError` unless η is a finite number > 0."""
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
        """Store the viscosity η [Pa s]."""
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
        """Raise `SceneError` unless ratio and frequency are finite numbers > 0."""
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
        """Store β [s], and the constant of the forms that is β/Δt."""
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


@dataclass(frozen=True)
class NumericalDamping(Windowed):
    """High-frequency dissipation of Armero and Petöcz, equation (22): ξ ∫ ΔE:ℂ₀:ΔE dV per step.

    The ends of its window release no rigid body.

    Attributes:
        xi: ξ ≥ 0, dimensionless; the scheme is of first order in Δt where ξ > 0.
    """

    xi: float

    def __post_init__(self) -> None:
        """Raise `SceneError` if ξ is negative, above ½ or not finite."""
        super().__post_init__()
        if not 0 <= number("NumericalDamping", "xi", self.xi) <= 0.5:
            raise SceneError(f"NumericalDamping: xi must lie in [0, 1/2], got {shown(self.xi)}.")

    @property
    def numerical_damping(self) -> float:
        """ξ."""
        return float(self.xi)

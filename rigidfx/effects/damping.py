"""Damping: viscous stresses, which are terms of the compiled forms, and ξ of the scheme."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from math import pi
from typing import Any, ClassVar, Literal, Self

import ufl
from dolfinx import fem
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import number, positive, shown
from rigidfx.base.taken import Checks
from rigidfx.base.warning import warn
from rigidfx.effects.action import FormTerm
from rigidfx.effects.base import Windowed
from rigidfx.mechanics.element import Element, Portion
from rigidfx.mechanics.schemes import Law, initial_stiffness_times


class ViscousTerm(FormTerm):
    """A stress S = η ΔE/Δt in the compiled forms."""

    viscous = True
    law: Literal["elastic", "viscous"] = "viscous"  # what the modulus multiplies: see `Portion`

    def __init__(self, kind: str, modulus: float, mesh: Any) -> None:
        """Store the modulus η [Pa s], and the constant of the forms that is modulus/Δt."""
        self.kind, self._modulus, self._rate = kind, modulus, fem.Constant(mesh, modulus)

    def set_time(self, t: float, dt: float) -> None:
        """Set modulus/Δt."""
        self.set_rate(1 / dt)

    def set_rate(self, rate: float) -> None:
        """Set the modulus times a rate [1/s]."""
        self._rate.value = self._modulus * rate

    def increment(self, element: Element, u0: Any, u1: Any) -> Any:
        """ΔE of a step from u₀ to u₁."""
        return element.viscous_strain_increment(u0, u1)

    def stress(self, dE: Any) -> Any:
        """S by ΔE [Pa]."""
        return self._rate * dE

    def virtual_work(self, element: Element, u0: Any, u1: Any, w: Any) -> Any:
        """F½ S : Grad w."""
        S, portion = self.stress(self.increment(element, u0, u1)), (u1, u0, 0.0, self._rate)
        return element.virtual_work(S, (Portion(self.law, *portion),), (u0, u1), w)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """The derivative of S by u₁ at F½."""
        return element.viscous_eliminated((u0, u1), u1, self._rate, w, du)

    def taken(self, element: Element, u0: Any, u1: Any) -> Any:
        """S:ΔE [J/m³]."""
        dE = self.increment(element, u0, u1)
        return ufl.inner(self.stress(dE), dE)


class ProportionalTerm(ViscousTerm):
    """S = β ℂ₀:ΔE/Δt in the compiled forms, of one law; its modulus is β [s]."""

    law = "elastic"
    _law: Law

    def of(self, law: Law) -> Self:
        """The stress in cells of a law."""
        out = copy(self)
        out._law = law
        return out

    def increment(self, element: Element, u0: Any, u1: Any) -> Any:
        """ΔE of a step from u₀ to u₁."""
        return element.strain_increment(u0, u1)

    def stress(self, dE: Any) -> Any:
        """S by ΔE [Pa]."""
        return self._rate * initial_stiffness_times(self._law.energy, self._law.parameters, dE)

    def eliminated(self, element: Element, u0: Any, u1: Any, w: Any, du: Any) -> Any:
        """The derivative of S by u₁ at F½."""
        return element.eliminated((u0, u1), u1, 0.0, self._rate, w, du)


@dataclass(frozen=True)
class KelvinVoigt(Windowed):
    """Objective viscous stress S = η ΔE/Δt, which takes ∫ η ΔE:ΔE/Δt dV per step.

    It depends on strain rates only, so it damps neither rigid motions nor rigid bodies. Effects on
    the same cells add up.

    Attributes:
        eta: Viscosity η > 0 [Pa s].
        where: Name of a set of cells; everywhere if None.
    """

    checks: ClassVar[Checks] = {"eta": positive}
    on_cells: ClassVar[bool] = True

    eta: float
    where: str | None = None

    def term(self, mesh: Any) -> FormTerm:
        """The viscous stress."""
        return ViscousTerm(self.kind, float(self.eta), mesh)


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

    checks: ClassVar[Checks] = {"ratio": positive, "frequency": positive}
    on_cells: ClassVar[bool] = True

    ratio: float
    frequency: float
    where: str | None = None

    @property
    def beta(self) -> float:
        """β [s]."""
        return float(self.ratio) / (pi * float(self.frequency))

    def check(self, scene: Any) -> None:
        """Look its cells up; warn of a ratio at which nothing vibrates."""
        super().check(scene)
        warn_of_ratio(scene.comm, self.owner, self.ratio)

    def term(self, mesh: Any) -> FormTerm:
        """The viscous stress."""
        return ProportionalTerm(self.kind, self.beta, mesh)


def warn_of_ratio(comm: MPI.Intracomm, owner: str, ratio: float) -> None:
    """Warn of a damping ratio above the critical one."""
    if ratio > 1:
        warn(
            comm,
            f"{owner}: the damping ratio {ratio:.3g} is above the critical one, 1, so that nothing "
            "vibrates. Two per cent are 0.02.",
        )


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
    def numerical_damping(self) -> float:  # type: ignore[override]
        """ξ."""
        return float(self.xi)

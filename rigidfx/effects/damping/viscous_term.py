"""The common part of viscous stresses as terms of the compiled forms."""

from __future__ import annotations

from typing import Any, Literal

from rigidfx.effects.action import FormTerm
from rigidfx.mechanics.element import Element, Portion

__all__ = ["ViscousTerm"]


class ViscousTerm(FormTerm):
    """A stress that is a modulus times a strain increment over Δt."""

    viscous = True
    law: Literal["elastic", "viscous"] = "viscous"  # what the modulus multiplies: see `Portion`

    def __init__(self, modulus: float, rate: Any) -> None:
        """Take the modulus over, and the constant of the forms that is modulus/Δt."""
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

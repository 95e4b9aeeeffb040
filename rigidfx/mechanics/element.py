"""How a cell strains: deformation gradient and strain as functions of the displacement, in UFL.

Schemes, strain rates, stresses, the look for inverted cells and follower pressure ask an element
for them and form none of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import ufl

__all__ = ["Element", "StandardElement"]


class Element(Protocol):
    """The kinematics of a cell."""

    def deformation_gradient(self, u: Any) -> Any:
        """F = I + Grad u, equation (19), at a displacement u."""
        ...

    def right_cauchy_green(self, u: Any) -> Any:
        """C = 2 E + I of the strain E that makes stress."""
        ...

    def strain_increment(self, u0: Any, u1: Any) -> Any:
        """E₁ - E₀ of that strain."""
        ...


@dataclass(frozen=True)
class StandardElement:
    """The strain is that of the displacement alone: C = Fᵀ F."""

    def deformation_gradient(self, u: Any) -> Any:
        """F = I + Grad u, equation (19), at a displacement u."""
        return ufl.Identity(3) + ufl.grad(u)

    def right_cauchy_green(self, u: Any) -> Any:
        """C = Fᵀ F."""
        F = self.deformation_gradient(u)
        return F.T * F

    def strain_increment(self, u0: Any, u1: Any) -> Any:
        """E₁ - E₀ as sym(F½ᵀ Grad(u₁ - u₀)), which is the same.

        The difference of C₁ and C₀ has the rounding of numbers near one, however small it is: a
        viscous stress, which divides it by Δt, would be made of nothing else.
        """
        F = self.deformation_gradient((u0 + u1) / 2)
        return ufl.sym(F.T * ufl.grad(u1 - u0))

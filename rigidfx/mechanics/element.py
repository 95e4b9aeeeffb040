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

"""How a cell strains: deformation gradient and strain as functions of the displacement, in UFL.

Schemes, strain rates, stresses, the look for inverted cells and follower pressure ask an element
for them and form none of their own. An element whose strain depends on more than the gradient of
the displacement gives the loss of tangents by elimination within a cell besides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import ufl


@dataclass(frozen=True)
class Portion:
    """A portion of a stress that is linear in strains: (factor + more) ℂ:(Ẽ(end) - Ẽ(start))."""

    # "elastic" for the stiffness ℂ of the stored energy, "viscous" for the identity. If the stored
    # energy is not quadratic, a stress that follows from it has but one portion, "elastic", whose
    # end alone means something
    law: Literal["elastic", "viscous"]
    end: Any  # a displacement, that of derivatives
    start: Any = None  # another, whose strain is taken off; None if none is
    factor: float = 1.0
    more: Any = None  # a constant that is added to the factor; None for none


class Element(Protocol):
    """The kinematics of a cell.

    Attributes:
        name: Its name in a scene.
        locks: Whether first-order cells of it lock in bending and at ν near ½.
        buckles: Whether its cells may buckle under compression before their material does.
    """

    name: ClassVar[str]
    locks: ClassVar[bool]
    buckles: ClassVar[bool]

    def deformation_gradient(self, u: Any) -> Any:
        """F = I + Grad u, equation (19), at a displacement u."""
        ...

    def right_cauchy_green(self, u: Any) -> Any:
        """C = 2 E + I of the strain E that makes stress."""
        ...

    def strain_increment(self, u0: Any, u1: Any) -> Any:
        """E₁ - E₀ of that strain."""
        ...

    def viscous_strain_increment(self, u0: Any, u1: Any) -> Any:
        """E₁ - E₀ of the strain that makes a viscous stress: η times it, over Δt."""
        ...

    def virtual_work(
        self, stress: Any, portions: Sequence[Portion], at: Sequence[Any], w: Any
    ) -> Any:
        """F S : Grad w, with F at the mean of displacements `at`.

        The last portion of the stress S is the one with the displacement of derivatives.
        """
        ...

    def eliminated(
        self, at: Sequence[Any], by: Any, factor: float, more: Any, w: Any, du: Any
    ) -> Any:
        """What the tangent of F S : Grad w loses by elimination, as an integrand; None if nothing.

        The mean of displacements `at` gives F. The derivative of S by the stress at `by` is factor
        + more, a constant or None for zero.
        """
        ...

    def viscous_eliminated(self, at: Sequence[Any], by: Any, rate: Any, w: Any, du: Any) -> Any:
        """The same of a viscous stress, whose factor is the constant η/Δt."""
        ...


@dataclass(frozen=True)
class StandardElement:
    """The strain is that of the displacement alone: C = Fᵀ F."""

    name: ClassVar[str] = "standard"
    locks: ClassVar[bool] = True
    buckles: ClassVar[bool] = False

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

    def viscous_strain_increment(self, u0: Any, u1: Any) -> Any:
        """The same."""
        return self.strain_increment(u0, u1)

    def virtual_work(
        self, stress: Any, portions: Sequence[Portion], at: Sequence[Any], w: Any
    ) -> Any:
        """F S : Grad w."""
        F = self.deformation_gradient(at[0] if len(at) == 1 else (at[0] + at[1]) / 2)
        return ufl.inner(F * stress, ufl.grad(w))

    def eliminated(
        self, at: Sequence[Any], by: Any, factor: float, more: Any, w: Any, du: Any
    ) -> Any:
        """Nothing."""
        return None

    def viscous_eliminated(self, at: Sequence[Any], by: Any, rate: Any, w: Any, du: Any) -> Any:
        """Nothing."""
        return None

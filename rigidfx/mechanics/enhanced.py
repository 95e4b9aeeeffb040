"""Enhanced strains: first-order hexahedra that bend and shear without locking.

The Green-Lagrange strain is enhanced, not the deformation gradient (S. Klinkel and W. Wagner,
IJNME 40 (1997) 4121; J.C. Simo and M.S. Rifai, IJNME 29 (1990) 1595):

    Ẽ = E(u) + M α,    M = (j₀/j) J₀⁻ᵀ M_ξ J₀⁻¹,    ∫ M : ∂W/∂Ẽ dV = 0 in each cell,

J the Jacobian of the cell's map, j its determinant, J₀ and j₀ those at the cell's centre. ∫ M dV =
0, so that constant strains are left alone (patch test). M_ξ has 21 modes in ξ, η, ζ from -1 to 1:

    11: ξ, ξη, ξζ      12: ξ, η, ξζ, ηζ
    22: η, ξη, ηζ      23: η, ζ, ξη, ξζ
    33: ζ, ξζ, ηζ      13: ξ, ζ, ξη, ηζ

For a stored energy that is quadratic in Ẽ, α is linear in E:

    α = -D⁻¹ e(u),   e = ∫ M : ℂ : E dV,   D = ∫ M : ℂ : M dV,

D constant for ever. Nothing is stored, nothing iterated, and nothing has to be rotated: α is a
function of the displacement. The averaged stress S_alg = (½ - ξ) S̃₀ + (½ + ξ) S̃₁ is orthogonal to M
as S̃₀ and S̃₁ are, so that ∫ S_alg : ΔE = ∫ S_alg : ΔẼ, the increment of the energy: energy and
momenta are kept as with the standard element (other energies: `rigidfx.mechanics.projected`).
Its tangent is

    K(S_alg) - (½ + ξ) B(u½)ᵀ D⁻¹ B(u₁),   B(u) = ∂e/∂u.

A viscous stress has an enhancement of its own, with the identity in the place of ℂ, so that it is
orthogonal to M too, takes η ∫ ΔẼ:ΔẼ/Δt ≥ 0, and does not lock either.

In UFL an enhancement η = M α is a coefficient, and the loss of a tangent a constant that is zero:
`rigidfx.flexible.elimination` computes their values, within the kernel of a form.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import ufl

from rigidfx.mechanics.element import Portion, StandardElement
from rigidfx.mechanics.enhancement import Enhancement, Note
from rigidfx.mechanics.projected import projected_work

__all__ = ["Elimination", "EnhancedElement"]

_STANDARD = StandardElement()


class Elimination(Note):
    """Zero, and what a tangent loses: (factor + more) B(left)ᵀ D⁻¹ B(right).

    Attributes:
        enhancement: The enhancement whose modes are eliminated.
        left: Numbers of displacements, whose mean is meant.
        right: Number of the displacement of the derivative.
        factor: See above.
        more: A constant, None for zero.
    """

    def __init__(
        self, enhancement: Enhancement, left: tuple[int, ...], factor: float, more: Any
    ) -> None:
        """Make a constant of the enhancement's mesh."""
        super().__init__(enhancement.ufl_function_space().ufl_domain())
        self.enhancement, self.left, self.right = enhancement, left, enhancement.end
        self.factor, self.more = factor, more


class EnhancedElement:
    """8-node hexahedra whose strain is enhanced by 21 modes."""

    name: ClassVar[str] = "enhanced"
    locks: ClassVar[bool] = False
    buckles: ClassVar[bool] = True

    def __init__(self, elastic: Any, viscous: Any, linear: bool = True) -> None:
        """Take over the data of the elimination of modes.

        Args:
            elastic: Function on the integration points with six components, whose first two values
                at a cell are λ and μ of its material at rest [Pa], and the third one 0.
            viscous: The same with 0 and ½, which make the identity of ℂ.
            linear: Whether stresses of all materials are linear functions of strains.
        """
        self._linear = linear
        self.laws = {"elastic": elastic, "viscous": viscous}
        self._known: WeakKeyDictionary[Any, dict[Any, Enhancement]] = WeakKeyDictionary()

    def _enhancement(self, law: str, u: Any, start: Any = None) -> Enhancement:
        """The same coefficient for the same displacements."""
        number = None if start is None else start.count()
        known = self._known.setdefault(u, {})
        if (law, number) not in known:
            known[law, number] = Enhancement(self.laws[law], u.count(), number)
        return known[law, number]

    def deformation_gradient(self, u: Any) -> Any:
        """F = I + Grad u, equation (19), at a displacement u."""
        return _STANDARD.deformation_gradient(u)

    def right_cauchy_green(self, u: Any) -> Any:
        """C̃ = Fᵀ F + 2 M α, u a function."""
        return _STANDARD.right_cauchy_green(u) + 2 * self._enhancement("elastic", u).tensor

    def strain_increment(self, u0: Any, u1: Any) -> Any:
        """Ẽ₁ - Ẽ₀, without the rounding of either, u₀ and u₁ functions."""
        return _STANDARD.strain_increment(u0, u1) + self._enhancement("elastic", u1, u0).tensor

    def viscous_strain_increment(self, u0: Any, u1: Any) -> Any:
        """Ẽ₁ - Ẽ₀ with modes orthogonal to it, u₀ and u₁ functions."""
        return _STANDARD.strain_increment(u0, u1) + self._enhancement("viscous", u1, u0).tensor

    def virtual_work(
        self, stress: Any, portions: Sequence[Portion], at: Sequence[Any], w: Any
    ) -> Any:
        """F S : Grad w, or its stand-in by stresses that are no linear functions of strains."""
        if self._projects(portions):
            return projected_work(stress, portions[-1].end, at, w)
        return _STANDARD.virtual_work(stress, portions, at, w)

    def _projects(self, portions: Sequence[Portion]) -> bool:
        """Whether a stress of these portions has to be projected."""
        return not self._linear and portions[-1].law != "viscous"

    def eliminated(
        self, at: Sequence[Any], by: Any, factor: float, more: Any, w: Any, du: Any
    ) -> Any:
        """See `Element`; all displacements are functions."""
        if not self._linear:
            return None
        return _carried(self._enhancement("elastic", by), at, factor, more, w, du)

    def viscous_eliminated(self, at: Sequence[Any], by: Any, rate: Any, w: Any, du: Any) -> Any:
        """See `Element`; `at` has the start of the step first."""
        return _carried(self._enhancement("viscous", by, at[0]), at, 0.0, rate, w, du)


def _carried(of: Enhancement, at: Sequence[Any], factor: float, more: Any, w: Any, du: Any) -> Any:
    """A term that vanishes, and brings the elimination and its enhancement into a form."""
    zero = Elimination(of, tuple(u.count() for u in at), factor, more)
    return zero * ufl.inner(ufl.grad(du) * of.tensor, ufl.grad(w))

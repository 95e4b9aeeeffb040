"""Enhanced and assumed strains: first-order hexahedra that bend and shear without locking.

See docs/theory/elements.md for Ẽ = E(u) + M α, with α = -D⁻¹ e(u) linear in E, and for strains E13,
E23 and E33 that are interpolated from where bending does not produce them. Nothing is stored, and
nothing iterated in a cell. Tangents are those of the standard element less

    (½ + ξ) B(u½)ᵀ D⁻¹ B(u₁),   B(u) = ∂e/∂u.

In UFL an enhancement η = M α is a coefficient. What a form cannot say by a stress at the point is a
constant that is zero: the loss of a tangent, the forces ∫ Pᵀ S̄ : B(u½) of energies that are not
quadratic, and those of assumed strains. `rigidfx.flexible.elimination` computes the values of all
of them within the kernel of a form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import ufl
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from rigidfx.base.errors import SceneError
from rigidfx.mechanics.element import Portion, StandardElement

_STANDARD = StandardElement()
_PAIRS = (0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)  # as in `Enhancement`


class Enhancement(ufl.Coefficient):
    """η = M α at the integration points: components 11, 22, 33, 12, 23, 13.

    The first two values of the law at a cell are λ and μ [Pa]. `end` is the number of the
    displacement that it belongs to, `start` that of the one whose enhancement is taken off; None if
    none is.
    """

    def __init__(self, law: Any, end: int, start: int | None = None) -> None:
        super().__init__(law.ufl_function_space())
        self.law, self.end, self.start = law, end, start

    @property
    def tensor(self) -> Any:
        """Shape (3, 3)."""
        a, b, c, d, e, f = (self[i] for i in range(6))
        return ufl.as_matrix([[a, d, f], [d, b, e], [f, e, c]])


class Note(ufl.Constant):
    """Zero in a form, and data for the form's kernel."""


class ProjectedWork(Note):
    """Zero, and the virtual work of a stress that is no linear function of strains.

    It depends on the enhancements of the displacement `by` of derivatives; rows are at the mean of
    the displacements with the numbers `middle`.
    """

    def __init__(self, stress: Any, by: int, middle: tuple[int, ...]) -> None:
        of = [w for w in extract_coefficients(stress) if isinstance(w, Enhancement) and w.end == by]
        super().__init__(of[0].ufl_function_space().ufl_domain())
        self.stress, self.enhancements, self.middle, self.by = stress, of, middle, by

    def at_points(self, tangent: bool) -> Any:
        """To be found at the points: S, shape (6,); for a tangent ∂S/∂Ẽ behind it, (42,).

        In columns of ∂S/∂Ẽ the strain's shears count twice.
        """
        S = ufl.as_vector([self.stress[i, j] for i, j in _PAIRS])
        found = [S[a] for a in range(6)]
        if tangent:
            units = [[(1.0 if b < 3 else 0.5) * (a == b) for a in range(6)] for b in range(6)]
            by = [
                sum(ufl.derivative(S, w, ufl.as_vector(unit)) for w in self.enhancements)
                for unit in units
            ]
            found += [by[b][a] for a in range(6) for b in range(6)]
        return ufl.as_vector(found)


def projected_work(stress: Any, by: Any, at: Sequence[Any], w: Any) -> Any:
    """A term that vanishes, and brings the stress and its arguments into a form.

    Virtual strains are at the mean of displacements `at`, derivatives by the displacement `by`.
    """
    zero = ProjectedWork(stress, by.count(), tuple(u.count() for u in at))
    read = dict.fromkeys([*extract_coefficients(stress), *at, by])
    carried = [ufl.inner(c, c) for c in [*read, *extract_constants(stress)]]
    return zero * reduce(add, carried) * ufl.inner(ufl.grad(by), ufl.grad(w))


class Elimination(Note):
    """Zero, and what a tangent loses: (factor + more) B(left)ᵀ D⁻¹ B(right).

    The enhancement's modes are eliminated, at the mean of the displacements with the numbers
    `left`; `right` is that of the derivative, and `more` a constant, None for zero.
    """

    def __init__(
        self, enhancement: Enhancement, left: tuple[int, ...], factor: float, more: Any
    ) -> None:
        super().__init__(enhancement.ufl_function_space().ufl_domain())
        self.enhancement, self.left, self.right = enhancement, left, enhancement.end
        self.factor, self.more = factor, more


class EnhancedElement:
    """8-node hexahedra whose strain is enhanced by 21 modes."""

    name: ClassVar[str] = "enhanced"
    locks: ClassVar[bool] = False
    buckles: ClassVar[bool] = True

    def __init__(self, elastic: Any, viscous: Any, linear: bool = True) -> None:
        """Keep the data of the elimination of modes; all stresses may be linear in strains.

        Laws are functions on the integration points with six components, whose first two values at
        a cell are λ and μ of its material at rest [Pa], and the third one 0. The viscous one has 0
        and ½, which make the identity of ℂ.
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


@dataclass(frozen=True)
class AssumedStrains:
    """First-order hexahedra for thin curved parts, given to a scene as its element.

    From each facet of the surface the thickness goes through its cell and on through those behind
    it, facet by opposite facet. Other cells have enhanced strains.

    Attributes:
        thickness: Name of the facets of one side of the thin part, or of both.
    """

    thickness: str

    def __post_init__(self) -> None:
        if not isinstance(self.thickness, str):
            raise SceneError(
                "AssumedStrains: thickness must be the name of a surface that the thickness goes "
                f"away from, got {self.thickness!r}."
            )


class AssumedWork(Note):
    """Zero, and the virtual work of a stress by the rows of assumed strains.

    Portions are law, numbers of displacements, factor and constant; rows are at the mean of the
    displacements `middle`, derivatives by the displacement `by`.
    """

    def __init__(
        self,
        domain: Any,
        portions: Sequence[tuple[Any, int, int | None, float, Any]],
        middle: tuple[int, ...],
        by: int,
    ) -> None:
        super().__init__(domain)
        self.portions, self.middle, self.by = tuple(portions), middle, by


class AssumedElement(EnhancedElement):
    """8-node hexahedra of which some are thin in a known direction.

    Its laws have a third value: 1, 2 or 3 for the coordinate across the thickness, 0 for none.
    """

    name: ClassVar[str] = "assumed"

    def virtual_work(
        self, stress: Any, portions: Sequence[Portion], at: Sequence[Any], w: Any
    ) -> Any:
        """F S : Grad w, and its stand-in in kernels of thin cells."""
        if self._projects(portions):
            return super().virtual_work(stress, portions, at, w)
        by = portions[-1].end
        of = [
            (self.laws[p.law], p.end.count(), None if p.start is None else p.start.count(),
             p.factor, p.more)
            for p in portions
        ]  # fmt: skip
        domain = self.laws["elastic"].ufl_function_space().ufl_domain()
        zero = AssumedWork(domain, of, tuple(u.count() for u in at), by.count())
        plain = super().virtual_work(stress, portions, at, w)
        return plain + zero * ufl.inner(ufl.grad(by), ufl.grad(w))

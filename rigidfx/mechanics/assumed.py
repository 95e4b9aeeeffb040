"""Assumed natural strains: thin curved parts of one first-order hexahedron across.

Where it is known which way a cell is thin, its Green-Lagrange strain is taken in natural
coordinates ξ, η, ζ from -1 to 1, ζ across the thickness, E_ij = ½ (g_i·g_j - G_i·G_j). Those that
lock in bending are interpolated from where they do not (E.N. Dvorkin and K.J. Bathe, Engineering
Computations 1 (1984) 77; P. Betsch and E. Stein, Communications in Numerical Methods in
Engineering 11 (1995) 899), the rest is enhanced (S. Klinkel, F. Gruttmann and W. Wagner, Computers
and Structures 71 (1999) 43):

    E13 from (0, ∓1, 0),  E23 from (∓1, 0, 0),  E33 from (±1, ±1, 0)
    Ẽ = E_assumed(u) + M α,    11: ξ    22: η    12: ξ, η    33: ζ, ξζ, ηζ

Each assumed strain is a sum of Green-Lagrange strains elsewhere in the cell, with fixed weights: it
is quadratic in the displacement, and a rigid motion does not change it. Hence, with B = ∂E/∂u,

    E_assumed(u₁) - E_assumed(u₀) = B(u½)·(u₁ - u₀)

exactly, and B(u½)·(w × x½) = 0: with forces ∫ S_alg : B(u½) the step keeps energy and both momenta,
for the same reasons as with enhanced strains alone (`rigidfx.mechanics.enhanced`). These forces are
not F S : Grad w of a stress at the same point. A form has them by a constant that is zero: the
kernel of `rigidfx.flexible.elimination` finds the portions of the stress there, and does the rest.

A constant strain is found exactly by cells whose edges across the thickness are parallel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import ufl

from rigidfx.base.errors import SceneError
from rigidfx.mechanics.element import Portion
from rigidfx.mechanics.enhanced import EnhancedElement, Note


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
        """Check the name.

        Raises:
            SceneError: If it is no text.
        """
        if not isinstance(self.thickness, str):
            raise SceneError(
                "AssumedStrains: thickness must be the name of a surface that the thickness goes "
                f"away from, got {self.thickness!r}."
            )


class AssumedWork(Note):
    """Zero, and the virtual work of a stress by the rows of assumed strains.

    Attributes:
        portions: The parts of the stress: law, numbers of displacements, factor and constant.
        middle: Numbers of displacements, at whose mean the rows are.
        by: Number of the displacement of the derivative.
    """

    def __init__(
        self,
        domain: Any,
        portions: Sequence[tuple[Any, int, int | None, float, Any]],
        middle: tuple[int, ...],
        by: int,
    ) -> None:
        """Make a constant of a mesh."""
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

"""Stresses that are no linear function of strains, in cells whose strain is enhanced or assumed.

For another energy than St.Venant-Kirchhoff's, α that makes it stationary would have to be found by
iteration, and the averaged stress would not be orthogonal to the modes. But nothing asks for it to
be stationary: with the α of the material's stiffness at rest, λ and μ, however large the strain,

    Ẽ = E + M α,   α = -D⁻¹ ∫ M : ℂ₀ : E dV,      in short  Ẽ = P E,  P linear, fixed for a cell,

∫ W(Ẽ(u)) is a stored energy of the displacement like any other, and its forces are

    ∫ S : P δE = ∫ Pᵀ S : δE.

The discrete gradient S̄ of W between Ẽ₀ and Ẽ₁ has S̄ : (Ẽ₁ - Ẽ₀) = W₁ - W₀ at each point, and
Ẽ₁ - Ẽ₀ = P B(u½)·(u₁ - u₀), B = ∂E/∂u, as E is quadratic in u: forces ∫ Pᵀ S̄ : B(u½) keep energy,
and, since B(u½)·(w × x½) = 0, both momenta. Nothing is stored, and nothing iterated in a cell. For
small strains it is the enhanced element, whose patch tests it passes at any (P E = E where E is
constant). How little it is stiffer than one of stationary α at large strains is told in
docs/theory/elements.md. For a quadratic W, Pᵀ S = S: nothing is to be projected.

E.P. Kasper and R.L. Taylor, Computers and Structures 75 (2000) 237 and 251, have elements of large
strains without iteration in a cell by constant matrices, too.

A form has these forces by a constant that is zero: the kernel of `rigidfx.flexible.elimination`
finds the stress there.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

import ufl
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from rigidfx.mechanics.enhancement import Enhancement, Note

__all__ = ["ProjectedWork", "projected_work"]

_PAIRS = (0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)  # as in `Enhancement`


class ProjectedWork(Note):
    """Zero, and the virtual work of a stress that is no linear function of strains.

    Attributes:
        stress: S.
        enhancements: Those of the displacement of derivatives that it depends on.
        middle: Numbers of displacements, at whose mean the rows are.
        by: Number of the displacement of derivatives.
    """

    def __init__(self, stress: Any, by: int, middle: tuple[int, ...]) -> None:
        """Make a constant of the enhancements' mesh."""
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

    Args:
        stress: S.
        by: The displacement of derivatives.
        at: Displacements, at whose mean virtual strains are.
        w: Test function.
    """
    zero = ProjectedWork(stress, by.count(), tuple(u.count() for u in at))
    read = dict.fromkeys([*extract_coefficients(stress), *at, by])
    carried = [ufl.inner(c, c) for c in [*read, *extract_constants(stress)]]
    return zero * reduce(add, carried) * ufl.inner(ufl.grad(by), ufl.grad(w))

"""Enhanced strains in forms: a coefficient for M α, constants for the rest."""

from __future__ import annotations

from typing import Any

import ufl

__all__ = ["Enhancement", "Note"]


class Enhancement(ufl.Coefficient):
    """η = M α at the integration points: components 11, 22, 33, 12, 23, 13.

    Attributes:
        law: Function whose first two values at a cell are λ and μ [Pa].
        end: Number of the displacement that it belongs to.
        start: Number of the displacement whose enhancement is taken off; None if none is.
    """

    def __init__(self, law: Any, end: int, start: int | None = None) -> None:
        """Make a coefficient of the space of a law."""
        super().__init__(law.ufl_function_space())
        self.law, self.end, self.start = law, end, start

    @property
    def tensor(self) -> Any:
        """Shape (3, 3)."""
        a, b, c, d, e, f = (self[i] for i in range(6))
        return ufl.as_matrix([[a, d, f], [d, b, e], [f, e, c]])


class Note(ufl.Constant):
    """Zero in a form, and data for the form's kernel."""

"""Indicators: a number per flexible cell and step, for a criterion to judge cells by."""

from __future__ import annotations

from typing import Protocol

from dolfinx import fem

from rigidfx.base.types import Array, Indices
from rigidfx.flexible.internal_forces import Cells


class Indicator(Protocol):
    """A measure of flexible cells in a step.

    Attributes:
        cells: Owned cells that are measured, sorted.
        values: Number of each owned cell in the last step, zero where none is measured.
        weights: ∫ Ė:Ė dV of each owned cell over its number squared, [m³] for strain rates.
    """

    @property
    def cells(self) -> Indices:
        """Owned cells that are measured, sorted."""
        ...

    @property
    def values(self) -> Array:
        """Number of each owned cell."""
        ...

    @property
    def weights(self) -> Array:
        """Weight of the square of each number."""
        ...

    def bind(
        self, flexible: Cells, between: tuple[fem.Function, fem.Function] | None = None
    ) -> None:
        """Measure these cells from now on.

        Args:
            flexible: Owned cells by subdomain id.
            between: Displacements at the ends of a step, in place of the forms' u₀ and u₁.
        """
        ...

    def measure(self, dt: float) -> Array:
        """Measure the bound cells in the step that the forms' u₀ and u₁ hold, in their order."""
        ...

    def strains(self) -> Array:
        """The integral over time that the bound cells would have of it, from no displacement on.

        That is of each owned cell, zero where none is measured, at the forms' u₀.
        """
        ...

"""The structure that effects are bound to, with the surface that pressures act on."""

from __future__ import annotations

from dataclasses import dataclass

from rigidfx.base.types import Array
from rigidfx.effects import Structure
from rigidfx.flexible.surface import Surface

__all__ = ["BoundStructure"]


@dataclass(frozen=True, kw_only=True)
class BoundStructure(Structure):
    """A division of a scene.

    Attributes:
        surface: The deformed boundary.
    """

    surface: Surface

    def outward_moments(self, where: str, owner: str) -> Array:
        """See `rigidfx.flexible.surface.Surface.outward_moments`. Collective."""
        return self.surface.outward_moments(where, owner, self.bodies)

    def outward_slopes(self, where: str, owner: str) -> Array:
        """See `rigidfx.flexible.surface.Surface.outward_slopes`. Collective."""
        return self.surface.outward_slopes(where, owner, self.bodies)

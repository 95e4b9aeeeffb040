"""Parts that deform by a few shapes from the beginning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.effects.rigid import Rigid

__all__ = ["Reduced"]


@dataclass(frozen=True)
class Reduced(Rigid):
    """Cells that move as one body which deforms by a few shapes in its own frame.

    For parts that vibrate and hardly bend: rotations inside the part, beside those of its frame,
    should stay below some hundredths. It has 6 unknowns and one for each shape, whatever its mesh.

    Attributes:
        where: Name of a set of cells; all cells if None.
        each: If False, all disconnected pieces of the set are one body; each is one otherwise.
        shapes: Number of shapes. If None, the static responses of the structure to the forces that
            act on it anywhere, and what follows from these by inertia, as many as they need.
        stiff: Sets of its cells that move rigidly in each shape. A scene puts the `Rigid` parts
            here that share nodes with it.
    """

    is_rigid: ClassVar[bool] = False
    deforms: ClassVar[bool] = True

    shapes: int | None = field(default=None, kw_only=True)
    stiff: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if mass or inertia are given, or shapes is no whole number ≥ 1."""
        if self.given:
            raise SceneError(
                f"{self.owner}: mass and inertia cannot be given, as its shapes have those of its "
                f"cells. Give its material another rho, or take Rigid({self.where!r})."
            )
        super().__post_init__()
        whole = isinstance(self.shapes, (int, np.integer)) and not isinstance(self.shapes, bool)
        if self.shapes is not None and not (whole and self.shapes >= 1):
            raise SceneError(
                f"{self.owner}: shapes must be a whole number ≥ 1, or None for as many as the "
                f"forces need, got {shown(self.shapes)}. A part without shapes is "
                f"Rigid({self.where!r})."
            )

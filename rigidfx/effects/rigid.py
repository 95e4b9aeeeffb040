"""Parts that are rigid from the beginning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import numbers, positive, shown
from rigidfx.effects.base import WHOLE, Effect

__all__ = ["Rigid"]

SYMMETRY = 1e-6  # of a given tensor, relative to its largest entry; the rest is averaged out


@dataclass(frozen=True)
class Rigid(Effect):
    """Cells that move as one rigid body from the beginning, whatever forces act on them.

    Name only parts that in truth hardly bend: a part that does changes the motion of its neighbours
    too, and only `rf.compliance` tells by how much.

    A body whose nodes a support holds is refused, unless all components of three or more of its
    nodes that do not lie on a line are held by one support: then it is fixed, or follows the
    support's motion.

    Attributes:
        where: Name of a set of cells; all cells if None.
        mass: Mass in place of the computed one [kg].
        inertia: Inertia about the centre of mass in place of the computed one, shape (3, 3)
            [kg m²].
        each: Whether each piece of the set, which shares no node with the others, is a body of its
            own, of the given mass and inertia: those of "nut" are called "nut 1", "nut 2", ... One
            body of all if False; so it is, with a warning where there are several, if None.
    """

    is_rigid: ClassVar[bool] = True

    where: str | None = None
    mass: float | None = None
    inertia: Sequence[Sequence[float]] | None = None
    each: bool | None = field(default=None, kw_only=True)

    @property
    def name(self) -> str:
        """Name of the body in reports."""
        return self.where or WHOLE

    @property
    def joins(self) -> tuple[str | None, ...]:
        """Its cells."""
        return (self.where,)

    @property
    def given(self) -> bool:
        """Whether it has a mass or an inertia other than that of its cells."""
        return self.mass is not None or self.inertia is not None

    def check(self, scene: Any) -> None:
        """Look its cells up."""
        scene.owned_cells(self.where, self.kind)

    def __post_init__(self) -> None:
        """Check the given data.

        Raises:
            SceneError: If each is no truth value, the mass is not positive or the inertia not
                symmetric positive definite with principal moments that a body can have.
        """
        super().__post_init__()
        if self.each is not None and not isinstance(self.each, (bool, np.bool_)):
            raise SceneError(f"Rigid: each must be True, False or None, got {shown(self.each)}.")
        if self.mass is not None:
            positive("Rigid", "mass", self.mass)
        if self.inertia is None:
            return
        J = numbers(self.inertia)
        shaped = J.shape == (3, 3) and np.isfinite(J).all()
        if not shaped or np.abs(J - J.T).max() > SYMMETRY * np.abs(J).max():
            raise SceneError(
                f"Rigid: inertia must be a symmetric 3×3 matrix, got {shown(self.inertia)}."
            )
        a, b, c = np.linalg.eigvalsh(J)
        if a <= 0 or c > (a + b) * (1 + 1e-9):
            raise SceneError(
                f"Rigid: no body has the principal moments of inertia {a:.3g}, {b:.3g}, {c:.3g}: "
                "they must be positive and none above the sum of the others."
            )

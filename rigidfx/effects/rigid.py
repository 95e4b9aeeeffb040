"""Parts that are one body from the beginning: rigid, or deforming by a few shapes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import names, numbers, positive, shown
from rigidfx.base.taken import Checks
from rigidfx.effects.base import WHOLE, Effect, at_least_one, is_truth, must_be

SYMMETRY = 1e-6  # of a given tensor, relative to its largest entry; the rest is averaged out


@dataclass(frozen=True)
class Rigid(Effect):
    """Cells that move as one rigid body from the beginning, whatever forces act on them.

    Name only parts that hardly bend in reality. Otherwise the motion of the neighbours is wrong,
    too; only `rf.compliance` shows this error.

    A support on its nodes is an error, unless one support holds all components of three or more
    nodes that do not lie on a line: then the part is fixed, or follows that support.

    Attributes:
        where: Name of a set of cells; all cells if None.
        mass: Mass in place of the computed one [kg].
        inertia: Inertia about the centre of mass in place of the computed one, shape (3, 3)
            [kg m²].
        each: If True, each disconnected piece of the set is a body with the given mass and
            inertia: those of "nut" are "nut 1", "nut 2", ... If False, all pieces are one body. If
            None, also, with a warning if there are several pieces.
    """

    is_rigid: ClassVar[bool] = True
    is_body: ClassVar[bool] = True
    deforms: ClassVar[bool] = False  # whether the body does so by shapes
    checks: ClassVar[Checks] = {"mass": positive, "each": must_be("True, False or None", is_truth)}
    on_cells: ClassVar[bool] = True

    where: str | None = None
    mass: float | None = None
    inertia: Sequence[Sequence[float]] | None = None
    each: bool | None = field(default=None, kw_only=True)

    @property
    def name(self) -> str:
        """Name of the body in reports."""
        return self.where or WHOLE

    @property
    def joins(self) -> tuple[str | None, ...]:  # type: ignore[override]
        """Its cells."""
        return (self.where,)

    @property
    def given(self) -> bool:
        """Whether it has a mass or an inertia other than that of its cells."""
        return self.mass is not None or self.inertia is not None

    def __post_init__(self) -> None:
        """Refuse an inertia that is not symmetric positive definite, as a body's is."""
        super().__post_init__()
        if self.inertia is None:
            return
        J = numbers(self.inertia)
        shaped = J.shape == (3, 3) and np.isfinite(J).all()
        if not shaped or np.abs(J - J.T).max() > SYMMETRY * np.abs(J).max():
            raise SceneError(
                f"Rigid: inertia must be a symmetric 3×3 matrix, got {shown(self.inertia)}."
            )
        a, b, c = np.linalg.eigvalsh(J)
        if a <= 0 or c > (a + b) * (1 + SYMMETRY):
            raise SceneError(
                f"Rigid: no body has the principal moments of inertia {a:.3g}, {b:.3g}, {c:.3g}: "
                "they must be positive and none above the sum of the others."
            )


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
    checks: ClassVar[Checks] = Rigid.checks | {"shapes": at_least_one}

    shapes: int | None = field(default=None, kw_only=True)
    stiff: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        """Raise `SceneError` if mass or inertia are given, or another value cannot be used."""
        if self.given:
            raise SceneError(
                f"{self.owner}: mass and inertia cannot be given, as its shapes have those of its "
                f"cells. Give its material another rho, or take Rigid({self.where!r})."
            )
        super().__post_init__()
        object.__setattr__(self, "stiff", names(self.owner, "stiff", self.stiff, "cell sets"))

"""Effects at a point of a mean or rigid face: loads, springs and masses by themselves.

Such a *remote point* moves with the centre and the rotation of the face (`face_motion`). A force on
it is spread over the nodes. A moment M acts on three directions d_k of the face, which stay
perpendicular, by ½ M × d_k: these forces have no resultant, their moment is M, and their work is
that of M along the turn of the face.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import vector
from rigidfx.base.types import Array
from rigidfx.effects.base import WHOLE, Effect
from rigidfx.effects.joints.averages import Grounded
from rigidfx.effects.joints.checks import check_sides
from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.sides import Surface, side_of

__all__ = ["OnFace", "RemotePoint"]


@dataclass(frozen=True)
class RemotePoint:
    """A point of a face, and directions there.

    Attributes:
        place: The place.
        middle: The middle of the face.
        arm: From there to the place at the start, shape (3,) [m].
        directions: Three directions, along x, y and z at the start; none if nothing turns.
    """

    place: Vector
    middle: Vector
    arm: Array
    directions: tuple[Vector, ...]


class OnFace(Effect):
    """An effect that may act at a point of a face, with fields `where` and `at`."""

    places: ClassVar[tuple[type, ...]] = (str, Surface)
    turns: ClassVar[bool] = False  # whether it acts on directions too

    @property
    def face(self) -> Surface | None:
        """The face that it acts on; None if that is a set of cells or nodes."""
        where = getattr(self, "where", None)
        return where if isinstance(where, Surface) else None

    @property
    def follows(self) -> bool:
        """Whether the motion of its point changes its force there."""
        return True

    @property
    def sides(self) -> Sequence[Surface]:
        """The faces that it takes hold of, as those of joints."""
        return () if self.face is None else (self.face,)

    @property
    def owner(self) -> str:
        """Its name in messages, and where it acts."""
        where: Any = getattr(self, "where", None)
        return f"{self.kind} on {where.name if self.face else repr(where or WHOLE)}"

    def check_at(self) -> None:
        """Check the place.

        Raises:
            SceneError: If it is no point, or of no face.
        """
        at: Any = getattr(self, "at", None)
        if at is None:
            return
        vector(self, "at", at)
        if self.face is None:
            raise SceneError(
                f"{self.owner}: at is the place of a remote point of a MeanFace or a RigidFace. "
                "Give one of these in place of the set, or leave at out."
            )

    @property
    def remote(self) -> RemotePoint:
        """The point, once a scene has placed it."""
        return self._remote  # type: ignore[attr-defined]

    def placed(self, scene: Any) -> Self:
        """The effect with its point on the mesh. Collective.

        Args:
            scene: The problem.

        Raises:
            SceneError: On every rank, if the point is far from the face.
        """
        if (face := self.face) is None:
            return self
        side = side_of(scene, self.owner, face)
        assert not isinstance(side, Grounded)
        at: Any = getattr(self, "at", None)
        point = side.centre if at is None else np.asarray(at, dtype=np.float64)
        check_sides(scene, self.owner, (face,), (side,), point)
        directions = tuple(side.direction(e) for e in np.eye(3)) if self.turns else ()
        place, middle = side.place(point), side.place(side.centre)
        arm = place.start - middle.start
        return self.with_point(RemotePoint(place, middle, arm, directions))

    def with_point(self, remote: RemotePoint) -> Self:
        """The effect with a point that was found before."""
        out = copy(self)
        object.__setattr__(out, "_remote", remote)
        return out

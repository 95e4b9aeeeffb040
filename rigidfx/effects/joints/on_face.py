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
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import vector
from rigidfx.effects.action import Structure
from rigidfx.effects.base import WHOLE, Effect
from rigidfx.effects.joints.averages import Grounded
from rigidfx.effects.joints.checks import check_sides
from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.sides import Surface, side_of

__all__ = ["OnFace", "PointLaw", "RemotePoint"]

Array = npt.NDArray[np.float64]


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


class PointLaw:
    """Forces on the averages of a remote point, or of two points, as a resistance.

    Attributes:
        kind: Name of the effect's class.
        title: Name in reports; "" of a law that has no report.
        averages: The averages.
    """

    kind: str = ""
    title: str = ""
    averages: tuple[Vector, ...] = ()

    @property
    def rounding(self) -> float:
        """Size of a force that the machine precision is to be multiplied with [N]."""
        return 0.0

    def set_time(self, t: float, dt: float) -> None:
        """Evaluate functions of time for a step whose midpoint is t [s]; its end in statics.

        Raises:
            SceneError: On this rank, if a user's function fails.
        """

    def resistance(self, start: Array, moved: Array) -> Array:
        """Forces on the averages, shape (averages, 3) [N].

        Args:
            start: Where they are at the start of the step, shape (averages, 3).
            moved: Their increments, likewise.
        """
        raise NotImplementedError

    def stiffness(self, start: Array, moved: Array) -> Array:
        """Its derivative by averages at the end, shape (averages, 3, averages, 3) [N/m]."""
        raise NotImplementedError

    def work(self, start: Array, moved: Array) -> float:
        """Work of a load in the step [J]."""
        return 0.0

    def taken(self, start: Array, moved: Array) -> float:
        """Energy that it takes in the step [J]."""
        return 0.0

    def stored(self, p: Array) -> float:
        """Potential energy where averages are at p [J]."""
        return 0.0

    def told(self, start: Array, moved: Array) -> Any:
        """Its report of the step, if it has a title."""
        raise NotImplementedError


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

    def law(self, structure: Structure) -> PointLaw | None:
        """Its forces on the averages of its point that depend on the motion, if any. Collective.

        Args:
            structure: The division that it is bound to.
        """
        return None

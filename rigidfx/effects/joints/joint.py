"""What is between two sides, and the base of all joints: a place, and rows that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown, vector
from rigidfx.base.types import Array
from rigidfx.effects.base import WHOLE, Effect
from rigidfx.effects.base import Vector as Place
from rigidfx.effects.joints.checks import check_sides
from rigidfx.effects.joints.coordinates import Angle, Travel
from rigidfx.effects.joints.face_motion import Sided, Vector
from rigidfx.effects.joints.pieces import Pieces, perpendiculars
from rigidfx.effects.joints.round_surfaces import cylinder_of
from rigidfx.effects.joints.sides import (
    GROUND,
    Side,
    Surface,
    check_side,
    side_name,
    side_of,
)

__all__ = ["Aligned", "Between", "Joint", "axis_of"]


@dataclass(frozen=True)
class Between(Effect):
    """Something between two sides, in the whole run.

    Attributes:
        a: First side.
        b: Second side.
        name: Its name in reports; kind and sides if None.
    """

    many: ClassVar[str] = "joints"  # its kind, for messages
    named: ClassVar[str] = "the name of a Rigid part"  # a side that is a text, likewise

    a: Side
    b: Side
    name: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check name and sides.

        Raises:
            SceneError: If one of them cannot be used, or both sides are the same.
        """
        super().__post_init__()
        if self.name is not None and (not isinstance(self.name, str) or not self.name):
            raise SceneError(f"{self.kind}: name must be a text, got {shown(self.name)}.")
        for name in ("a", "b"):
            check_side(self.kind, name, getattr(self, name), self.named)
        same = isinstance(self.a, Surface) and isinstance(self.b, Surface)
        if self.a == self.b or (same and self.joins[0] == self.joins[1]):
            raise SceneError(
                f"{self.owner}: both sides are the same. A {self.kind} is between two parts, or "
                f"one and the '{GROUND}'."
            )

    @property
    def title(self) -> str:
        """Its name in reports."""
        return self.name or f"{self.kind} {self.between}"

    @property
    def between(self) -> str:
        """Its sides in words."""
        return f"{side_name(self.a)} - {side_name(self.b)}"

    @property
    def owner(self) -> str:
        """Its name in messages."""
        return self.title if self.name is None else f"{self.kind} '{self.name}'"

    @property
    def sides(self) -> tuple[Side, Side]:
        """Both sides, as they were given."""
        return self.a, self.b

    @property
    def averages(self) -> Sequence[Vector]:
        """Places and directions that it acts on, once a scene has placed it."""
        raise NotImplementedError

    @property
    def holds(self) -> bool:  # type: ignore[override]
        """Whether one side is the ground."""
        return GROUND in (self.a, self.b)

    @property
    def where(self) -> str | None:
        """Set of the first side that is not the ground; None means all cells."""
        return self.joins[0]

    @property
    def joins(self) -> tuple[str | None, ...]:
        """The sets of its sides."""
        sides = (s.where if isinstance(s, Surface) else s for s in self.sides)
        return tuple(None if where == WHOLE else where for where in sides if where != GROUND)

    def check_title(self, scene: Any) -> None:
        """See whether no other one has its title.

        Raises:
            SceneError: If one has.
        """
        if [other.title for other in scene.named(Between)].count(self.title) > 1:
            raise SceneError(
                f"{self.owner}: two {self.many} are called '{self.title}'; give one a name of its "
                "own."
            )


@dataclass(frozen=True)
class Joint(Between):
    """Holds two sides together, in the whole run.

    Attributes:
        a: First side: "ground", the name of a `Rigid` part, a `MeanFace` or a `RigidFace`.
        b: Second side, likewise.
        at: Its place at the start [m]; the middle of the hole or shaft that the first face of its
            sides is, if None.
        name: Its name in reports; kind and sides if None.
    """

    at: Place | None = None

    def __post_init__(self) -> None:
        """Check sides, place and name.

        Raises:
            SceneError: If one of them cannot be used.
        """
        super().__post_init__()
        if self.at is not None:
            vector(self, "at", self.at)

    @property
    def pieces(self) -> Pieces:
        """Its averages and rows, once a scene has placed it."""
        return self._pieces  # type: ignore[attr-defined]

    @property
    def averages(self) -> Sequence[Vector]:
        """See `Between`."""
        return self.pieces.averages

    def placed(self, scene: Any) -> Joint:
        """The joint with its averages over the nodes of a mesh. Collective.

        Args:
            scene: The problem.

        Raises:
            SceneError: On every rank, if it cannot be there.
        """
        self.check_title(scene)
        if (missing := self.missing) and (found := self._found(scene, missing)) is not self:
            return found.placed(scene)
        a, b = (side_of(scene, self.owner, side) for side in (self.a, self.b))
        point = np.asarray(self.at, dtype=np.float64)
        check_sides(scene, self.owner, (self.a, self.b), (a, b), point)
        size, mass = min(a.size, b.size), min(a.mass, b.mass)
        pieces = Pieces(float(size), float(mass))
        self.build(pieces, a, b)
        out = copy(self)
        object.__setattr__(out, "_pieces", pieces)
        return out

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the fields that a surface is to tell."""
        return () if self.at is not None else ("at",)

    def _found(self, scene: Any, missing: tuple[str, ...]) -> Joint:
        """The joint with the place and axis that the surface of a side tells. Collective.

        Raises:
            SceneError: If no side is a surface, or it is no cylinder.
        """
        surfaces = [side.where for side in self.sides if isinstance(side, Surface)]
        if not surfaces:
            raise SceneError(
                f"{self.owner}: give its {' and '.join(missing)}; only a MeanFace or a "
                "RigidFace that is a hole or a shaft tells them."
            )
        centre, axis = self.shape_of(scene, surfaces[0])
        told: dict[str, Any] = {"at": tuple(map(float, centre)), "axis": tuple(map(float, axis))}
        return replace(self, **{name: told[name] for name in missing})

    def shape_of(self, scene: Any, where: str) -> tuple[Array, Array]:
        """Middle and axis of a surface, shapes (3,). Collective.

        Args:
            scene: The problem.
            where: Name of the surface.

        Raises:
            SceneError: If it is no cylinder.
        """
        return cylinder_of(scene, self.owner, where)

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Add its averages and rows.

        Args:
            pieces: The target of the addition.
            a: First side.
            b: Second side.
        """
        raise NotImplementedError

    def meet(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Add that both sides have the joint's place in common."""
        pieces.point_on_point(*self.points(pieces, a, b))

    def points(self, pieces: Pieces, a: Sided, b: Sided) -> tuple[int, int]:
        """Numbers of the joint's place on both sides."""
        point = np.asarray(self.at, dtype=np.float64)
        return pieces.add(a.place(point), 0), pieces.add(b.place(point), 1)

    def align(self, pieces: Pieces, a: Sided, b: Sided, axis: Array) -> Aligned:
        """Add that an axis of the first side is perpendicular to two directions of the second.

        Args:
            pieces: The target of the addition.
            a: First side.
            b: Second side.
            axis: The axis at the start, of unit length.
        """
        across = perpendiculars(axis)
        along = pieces.add(a.direction(axis), 0)
        numbers = [pieces.add(b.direction(e), 1) for e in across]
        for k, number in enumerate(numbers):
            pieces.perpendicular(along, number, f"tilt {k + 1}")
        return Aligned(a, across, along, (numbers[0], numbers[1]))


@dataclass(frozen=True)
class Aligned:
    """How two sides have an axis in common.

    Attributes:
        one: The first side, whose axis it is.
        across: Two directions across at the start.
        along: Number of the axis.
        numbers: Numbers of these directions on the second side.
    """

    one: Sided
    across: tuple[Array, Array]
    along: int
    numbers: tuple[int, int]

    def hold_angle(self, pieces: Pieces) -> None:
        """Add that the sides do not turn about the axis."""
        own = pieces.add(self.one.direction(self.across[0]), 0)
        pieces.perpendicular(own, self.numbers[1], "turn")

    def leave_angle(self, pieces: Pieces) -> None:
        """Measure the angle about the axis."""
        own = pieces.add(self.one.direction(self.across[0]), 0)
        pieces.coordinates["angle"] = Angle((own, *self.numbers))

    def leave_travel(self, pieces: Pieces, points: tuple[int, int]) -> None:
        """Measure the travel along the axis."""
        pieces.coordinates["travel"] = Travel((*points, self.along))

    def hold_place(self, pieces: Pieces, points: tuple[int, int]) -> None:
        """Add that the joint's places stay on one line along the axis."""
        for k, number in enumerate(self.numbers):
            pieces.in_plane(*points, number, f"across {k + 1}")


def axis_of(joint: Joint, axis: Any) -> Array:
    """A unit vector along a joint's axis, shape (3,).

    Raises:
        SceneError: If the axis has no length.
    """
    given = vector(joint, "axis", axis)
    length = float(np.linalg.norm(given))
    if not length > 0:
        raise SceneError(f"{joint.owner}: its axis has no length, got {shown(axis)}.")
    return np.asarray(given / length)

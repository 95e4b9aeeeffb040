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
from rigidfx.effects.joints.averages import Vector
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.round_surfaces import cylinder_of
from rigidfx.effects.joints.sides import (
    GROUND,
    Side,
    Surface,
    check_side,
    check_sides,
    side_name,
    side_of,
)

__all__ = ["Between", "Joint", "axis_of"]


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

    shares: ClassVar[tuple[str, ...]] = ()  # what `Pieces` hold: "point", "axis", "line", ...
    leaves: ClassVar[tuple[str, ...]] = ()  # and measure: "angle", "travel"

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
        pieces, out = Pieces(a, b, point, self.direction), copy(self)
        self.build(pieces)
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

    @property
    def direction(self) -> Array:
        """Its axis at the start, or any for want of one, shape (3,)."""
        return np.eye(3)[0]

    def build(self, pieces: Pieces) -> None:
        """Add its averages and rows."""
        pieces.hold(self.shares, self.leaves)


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

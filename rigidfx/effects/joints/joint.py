"""What is between two sides, and joints: what the sides share of a place, and leave free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Any, ClassVar

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import direction, vector
from rigidfx.base.taken import Checks
from rigidfx.base.types import Array, Indices
from rigidfx.effects.base import WHOLE, Effect, text
from rigidfx.effects.base import Vector as Place
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.sides import (
    GROUND,
    Side,
    Surface,
    check_sides,
    cylinder_of,
    one_side,
    rigid_faces,
    side_name,
    side_of,
    sphere_of,
)
from rigidfx.effects.joints.vectors import Vector
from rigidfx.effects.supports import Support, Symmetry

Supports = tuple[tuple[Support, Indices], ...]
PART = "the name of a Rigid part"  # a side that is a text
RIGHT_ANGLE = 1e-6  # cosine that the axes of a universal joint may have at the start


@dataclass(frozen=True)
class Between(Effect):
    """Something between two sides a and b, in the whole run."""

    checks: ClassVar[Checks] = {"name": text("a text")} | dict.fromkeys("ab", one_side(PART))
    many: ClassVar[str] = "joints"  # its kind, for messages
    averages: ClassVar[Sequence[Vector]]  # that it acts on, once a scene has placed it

    a: Side
    b: Side
    name: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Refuse names that are none, sides that cannot be used, and the same side twice."""
        super().__post_init__()
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
    def holds(self) -> bool:  # type: ignore[override]
        """Whether one side is the ground."""
        return GROUND in (self.a, self.b)

    @property
    def where(self) -> str | None:
        """Set of the first side that is not the ground; None means all cells."""
        return self.joins[0]

    @property
    def joins(self) -> tuple[str | None, ...]:  # type: ignore[override]
        """The sets of its sides."""
        sides = (s.where if isinstance(s, Surface) else s for s in self.sides)
        return tuple(None if where == WHOLE else where for where in sides if where != GROUND)

    def check_title(self, scene: Any) -> None:
        """Refuse its title if another one has it."""
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
    unlike: ClassVar[str] = (  # of a surface that tells nothing
        "no cylinder, whose axis and middle could be found. Give the joint's place, and its axis "
        "if it has one."
    )
    checks: ClassVar[Checks] = Between.checks | {"at": vector}
    pieces: ClassVar[Pieces]  # its averages and rows, once a scene has placed it

    at: Place | None = None

    def placed(self, scene: Any) -> Joint:
        """The joint with averages over nodes; `SceneError` if it cannot be there. Collective."""
        self.check_title(scene)
        if missing := [name for name in ("at", "axis") if getattr(self, name, "") is None]:
            return self._found(scene, missing).placed(scene)
        sides = side_of(scene, self.owner, self.a), side_of(scene, self.owner, self.b)
        point = np.asarray(self.at, dtype=np.float64)
        check_sides(scene, self.owner, self.sides, sides, point)
        pieces = Pieces(*sides, point, self.direction)
        self.build(pieces)
        return self._with(pieces=pieces, averages=pieces.averages)

    def _found(self, scene: Any, missing: Sequence[str]) -> Joint:
        """The joint with what a surface of a side tells; raise `SceneError` without. Collective."""
        surfaces = [side.where for side in self.sides if isinstance(side, Surface)]
        if not surfaces:
            raise SceneError(
                f"{self.owner}: give its {' and '.join(missing)}; only a MeanFace or a "
                "RigidFace that is a hole or a shaft tells them."
            )
        if (shape := self.shape_of(scene, surfaces[0])) is None:
            raise SceneError(f"{self.owner}: the surface '{surfaces[0]}' is {self.unlike}")
        told = {name: tuple(map(float, v)) for name, v in zip(("at", "axis"), shape, strict=True)}
        return replace(self, **{name: told[name] for name in missing})  # type: ignore[arg-type]

    def shape_of(self, scene: Any, where: str) -> tuple[Array, Array] | None:
        """Middle and axis of a surface, shapes (3,); None if it is no cylinder. Collective."""
        return cylinder_of(scene, self.owner, where)

    @property
    def direction(self) -> Array:
        """Its axis at the start, or any for want of one, shape (3,)."""
        return np.eye(3)[0]

    def build(self, pieces: Pieces) -> None:
        """Add its averages and rows."""
        pieces.hold(self.shares, self.leaves)


@dataclass(frozen=True)
class Axial(Joint):
    """A joint that has an axis.

    Attributes:
        axis: Direction of the axis at the start, of any length; that of the hole or shaft if None.
    """

    checks: ClassVar[Checks] = Joint.checks | {"axis": direction}

    axis: Place | None = None

    @property
    def direction(self) -> Array:
        """The axis at the start, of unit length."""
        return direction(self.kind, "axis", self.axis)


class Revolute(Axial):
    """A hinge: both sides share a point and an axis, and rotate about the axis."""

    shares = "point", "axis"
    leaves = ("angle",)


class Prismatic(Axial):
    """A slider: both sides slide along one axis, and do not turn."""

    shares = "axis", "line", "turn"
    leaves = ("travel",)


class Cylindrical(Axial):
    """Both sides share an axis; they rotate about it and slide along it."""

    shares = "axis", "line"
    leaves = "angle", "travel"


class Spherical(Joint):
    """A ball joint: both sides share a point and rotate freely about it.

    Without a place, it is at the centre of the ball or socket that the first face of its sides is.
    """

    shares = ("point",)
    unlike = (
        "neither a ball nor a socket, whose centre could be found, nor a hole nor a shaft. Give "
        "the joint's place (at)."
    )

    def shape_of(self, scene: Any, where: str) -> tuple[Array, Array] | None:
        """Centre of a ball or socket, or middle and axis of a hole or shaft."""
        return sphere_of(scene, self.owner, where) or super().shape_of(scene, where)


@dataclass(frozen=True)
class Universal(Joint):
    """A universal joint: both sides share a point; an axis of each stays normal to the other.

    Attributes:
        axis_a: Axis of the first side at the start, of any length.
        axis_b: Axis of the second side there, perpendicular to the first.
    """

    shares = ("point",)

    axis_a: Place | None = None
    axis_b: Place | None = None

    def __post_init__(self) -> None:
        """Refuse axes without length, and such as are not perpendicular."""
        super().__post_init__()
        one, other = self._axes
        if abs(one @ other) > RIGHT_ANGLE:
            angle = np.degrees(np.arccos(np.clip(one @ other, -1, 1)))
            raise SceneError(
                f"{self.owner}: its axes have to be perpendicular at the start, and are at "
                f"{angle:.3g}°."
            )

    @property
    def _axes(self) -> tuple[Array, Array]:
        """Both axes, of unit length."""
        a, b = (direction(self.kind, name, getattr(self, name)) for name in ("axis_a", "axis_b"))
        return a, b

    def build(self, pieces: Pieces) -> None:
        """Add the common point, and that the axes are perpendicular."""
        super().build(pieces)
        one, other = (pieces.direction(axis, side) for side, axis in enumerate(self._axes))
        pieces.hold_right_angle(one, other, "turn")


class Tied(Joint):
    """Both sides move as one: a bolted flange, or two surfaces whose meshes do not match.

    Mean faces are tied by their mean motion: each may deform by itself.
    """

    shares = "point", "axis", "turn"


class Mirrored(Axial):
    """Keeps a rigid face in a plane of symmetry that cuts it, across its axis; a scene adds it."""

    shares = "axis", "plane"


def cut_by_symmetry(scene: Any, supports: Supports) -> tuple[tuple[Joint, ...], Supports]:
    """What keeps rigid faces in the planes that cut them, and supports without these. Collective.

    The other half of such a face mirrors the given one: half of a hole, say. As both are one body,
    it moves along the plane and turns about its normal only. Rows of a joint hold the rest. A plane
    that does not hold all the time is refused on every rank.
    """
    joints, left = [], list(supports)
    for face in rigid_faces(scene.effects) if scene.named(Symmetry) else ():
        nodes = scene.nodes(face.where, face.name, (2,))
        for k, (plane, held) in enumerate(left):
            shared = np.intersect1d(nodes, held)
            x = scene.start_places[shared[shared < scene.owned_nodes]]
            sums = scene.sum(np.r_[len(x), x.sum(axis=0)])
            if not isinstance(plane, Symmetry) or sums[0] == 0:
                continue
            if plane.since > 0 or plane.until < inf:
                raise SceneError(
                    f"{plane.owner} cuts {face.name}, and has a time window. A rigid face is kept "
                    f"in a plane for the whole run: leave the window out, or take "
                    f"MeanFace('{face.where}')."
                )
            at, normal = tuple(sums[1:] / sums[0]), tuple(np.eye(3)[plane.axes[0]])
            name = f"{plane.owner} - {face.name}"
            if all(joint.title != name for joint in scene.named(Mirrored)):
                joint = Mirrored(GROUND, face, at, normal, name=name)
                joints.append(joint.placed(scene))
            left[k] = plane, np.setdiff1d(held, nodes)
    return tuple(joints), tuple(left)

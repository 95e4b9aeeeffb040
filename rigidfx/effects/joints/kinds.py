"""The kinds of joints: which rows each has, and which coordinates it leaves free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import Joint, axis_of
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.round_surfaces import sphere_of

__all__ = ["Axial", "Cylindrical", "Prismatic", "Revolute", "Spherical", "Tied", "Universal"]


RIGHT_ANGLE = 1e-6  # cosine that the axes of a universal joint may have at the start


@dataclass(frozen=True)
class Axial(Joint):
    """A joint that has an axis.

    Attributes:
        axis: Direction of the axis at the start, of any length; that of the hole or shaft if None.
    """

    axis: Vector | None = None

    def __post_init__(self) -> None:
        """Check the axis.

        Raises:
            SceneError: If it has no length.
        """
        super().__post_init__()
        if self.axis is not None:
            axis_of(self, self.axis)

    @property
    def missing(self) -> tuple[str, ...]:
        """See `Joint`."""
        return (*super().missing, *(() if self.axis is not None else ("axis",)))


@dataclass(frozen=True)
class Revolute(Axial):
    """A hinge: both sides share a point and an axis, and rotate about the axis."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point, and an axis."""
        self.meet(pieces, a, b)
        self.align(pieces, a, b, axis_of(self, self.axis)).leave_angle(pieces)


@dataclass(frozen=True)
class Prismatic(Axial):
    """A slider: both sides slide along one axis, and do not turn."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """An axis, points on it, and no rotation about it."""
        points = self.points(pieces, a, b)
        aligned = self.align(pieces, a, b, axis_of(self, self.axis))
        aligned.hold_place(pieces, points)
        aligned.hold_angle(pieces)
        aligned.leave_travel(pieces, points)


@dataclass(frozen=True)
class Cylindrical(Axial):
    """Both sides share an axis; they rotate about it and slide along it."""

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """An axis, and points on it."""
        points = self.points(pieces, a, b)
        aligned = self.align(pieces, a, b, axis_of(self, self.axis))
        aligned.hold_place(pieces, points)
        aligned.leave_angle(pieces)
        aligned.leave_travel(pieces, points)


@dataclass(frozen=True)
class Spherical(Joint):
    """A ball joint: both sides share a point and rotate freely about it.

    Without a place, it is at the centre of the ball or socket that the first face of its sides is.
    """

    def shape_of(self, scene: Any, where: str) -> tuple[Array, Array]:
        """Centre of a ball or socket, or middle and axis of a hole or shaft."""
        centre = sphere_of(scene, self.owner, where)
        if centre is not None:
            return centre, np.full(3, np.nan)
        try:
            return super().shape_of(scene, where)
        except SceneError:
            raise SceneError(
                f"{self.owner}: the surface '{where}' is neither a ball nor a socket, whose centre "
                "could be found, nor a hole nor a shaft. Give the joint's place (at)."
            ) from None

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point."""
        self.meet(pieces, a, b)


@dataclass(frozen=True)
class Universal(Joint):
    """A universal joint: both sides share a point; an axis of each stays normal to the other.

    Attributes:
        axis_a: Axis of the first side at the start, of any length.
        axis_b: Axis of the second side there, perpendicular to the first.
    """

    axis_a: Vector | None = None
    axis_b: Vector | None = None

    def __post_init__(self) -> None:
        """Check the axes.

        Raises:
            SceneError: If one has no length, or they are not perpendicular.
        """
        super().__post_init__()
        one, other = axis_of(self, self.axis_a), axis_of(self, self.axis_b)
        if abs(one @ other) > RIGHT_ANGLE:
            angle = np.degrees(np.arccos(np.clip(one @ other, -1, 1)))
            raise SceneError(
                f"{self.owner}: its axes have to be perpendicular at the start, and are at "
                f"{angle:.3g}°."
            )

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point, and axes across each other."""
        self.meet(pieces, a, b)
        one = pieces.add(a.direction(axis_of(self, self.axis_a)), 0)
        other = pieces.add(b.direction(axis_of(self, self.axis_b)), 1)
        pieces.perpendicular(one, other, "turn")


@dataclass(frozen=True)
class Tied(Joint):
    """Both sides move as one: a bolted flange, or two surfaces whose meshes do not match.

    Mean faces are tied by their mean motion: each may deform by itself.
    """

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """Point on point, and three directions."""
        self.meet(pieces, a, b)
        self.align(pieces, a, b, np.eye(3)[0]).hold_angle(pieces)

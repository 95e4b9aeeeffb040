"""The kinds of joints: which rows each has, and which coordinates it leaves free."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array, Indices
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.joint import Joint, axis_of
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.round_surfaces import sphere_of
from rigidfx.effects.joints.sides import GROUND, rigid_faces
from rigidfx.effects.supports.support import Support, Symmetry

__all__ = [
    "Axial",
    "Cylindrical",
    "Mirrored",
    "Prismatic",
    "Revolute",
    "Spherical",
    "Tied",
    "Universal",
    "cut_by_symmetry",
]


Supports = tuple[tuple[Support, Indices], ...]
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

    @property
    def direction(self) -> Array:
        """The axis at the start, of unit length."""
        return axis_of(self, self.axis)


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


@dataclass(frozen=True)
class Universal(Joint):
    """A universal joint: both sides share a point; an axis of each stays normal to the other.

    Attributes:
        axis_a: Axis of the first side at the start, of any length.
        axis_b: Axis of the second side there, perpendicular to the first.
    """

    shares = ("point",)

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

    def build(self, pieces: Pieces) -> None:
        """Add the common point, and that the axes are perpendicular."""
        super().build(pieces)
        one = pieces.direction(axis_of(self, self.axis_a), 0)
        other = pieces.direction(axis_of(self, self.axis_b), 1)
        pieces.hold_right_angle(one, other, "turn")


class Tied(Joint):
    """Both sides move as one: a bolted flange, or two surfaces whose meshes do not match.

    Mean faces are tied by their mean motion: each may deform by itself.
    """

    shares = "point", "axis", "turn"


class Mirrored(Axial):
    """Keeps a rigid face in a plane of symmetry; a scene adds it where one cuts the other.

    The axis is the plane's normal.
    """

    shares = "axis", "plane"


def cut_by_symmetry(scene: Any, supports: Supports) -> tuple[tuple[Joint, ...], Supports]:
    """What keeps rigid faces in the planes that cut them, and supports without these. Collective.

    The other half of such a face mirrors the given one: half of a hole, say. As both are one body,
    it moves along the plane and turns about its normal only. Rows of a joint hold the rest.

    Args:
        scene: The problem, whose effects are placed.
        supports: Its supports and their local nodes, ghosts included.

    Raises:
        SceneError: On every rank, if a plane that does not hold all the time cuts one.
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

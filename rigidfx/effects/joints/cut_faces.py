"""Rigid faces that a plane of symmetry cuts: half of a hole, whose body stays its own mirror image.

The other half of such a face mirrors the given one. As both are one body, it moves along the plane
and turns about the plane's normal only. Three rows hold the rest: its place on the normal, and the
normal against two directions of the plane. They are exact, as those of all joints are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Indices
from rigidfx.effects.base import Vector
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.joint import Joint, axis_of
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.effects.joints.sides import GROUND, rigid_faces
from rigidfx.effects.supports.support import Support
from rigidfx.effects.supports.symmetry import Symmetry

__all__ = ["Mirrored", "cut_by_symmetry"]

Supports = tuple[tuple[Support, Indices], ...]


@dataclass(frozen=True)
class Mirrored(Joint):
    """Keeps a rigid face in a plane of symmetry; a scene adds it where one cuts the other.

    Attributes:
        normal: Of the plane.
    """

    normal: Vector = field(kw_only=True)

    def build(self, pieces: Pieces, a: Sided, b: Sided) -> None:
        """The second side moves along the plane and turns about its normal."""
        points = self.points(pieces, a, b)
        aligned = self.align(pieces, a, b, axis_of(self, self.normal))
        pieces.in_plane(*points, aligned.along, "normal")


def cut_by_symmetry(scene: Any, supports: Supports) -> tuple[tuple[Joint, ...], Supports]:
    """What keeps rigid faces in the planes that cut them, and supports without these. Collective.

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
                joint = Mirrored(GROUND, face, at, name=name, normal=normal)
                joints.append(joint.placed(scene))
            left[k] = plane, np.setdiff1d(held, nodes)
    return tuple(joints), tuple(left)

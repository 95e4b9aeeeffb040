"""Point masses beside the middle of a face: small bodies without nodes that are tied to the face.

The place of such a mass turns with the face, so that its inertia depends on the motion. As a body
of its own it has its place and velocity, and the tie is a joint like others: energy and momenta are
exact, at switches too. The body's radius of gyration is SMALL times the size of the face. So the
inertia of the point m b² at the arm b is too large by (SMALL s/b)² at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rigidfx.base.types import Array
from rigidfx.effects.joints.averages import Average
from rigidfx.effects.joints.face_motion import motion_at
from rigidfx.effects.joints.pieces import Pieces
from rigidfx.mechanics.rigid_body import BodyMotion, RigidBody

if TYPE_CHECKING:
    from rigidfx.effects.joints.on_face import RemotePoint

__all__ = ["body_of", "tie"]


SMALL = 0.02  # radius of gyration over the size of the face; 1e-3 drowns low modes in rounding


@dataclass(frozen=True)
class BodyVector(Average):
    """The origin or a direction of the body of a name.

    Attributes:
        name: Name of the body.
    """

    name: str = ""

    @property
    def holder(self) -> BodyVector:
        """Finds the body."""
        return self

    def within(self, scene: Any, bodies: Sequence[RigidBody]) -> tuple[int, Array, Array] | None:
        """See `FaceSide`."""
        numbers = [k for k, body in enumerate(bodies) if body.name == self.name]
        return (numbers[0], np.zeros(3), np.eye(3)) if numbers else None

    def in_body(self, centre: Array, products: Array) -> Array:
        """See `FaceVector`; its frame is that of space at the start."""
        return np.r_[1.0, centre] if self.is_place else np.r_[0.0, self.start]


def tie(name: str, remote: RemotePoint, mass: float) -> Pieces:
    """Averages and rows of the tie between a face and the body of a mass.

    Args:
        name: Name of the body.
        remote: The point of the face, with three directions.
        mass: The mass [kg].
    """
    place = remote.place
    assert place.face is not None
    pieces = Pieces(place.face.size, min(mass, place.face.mass))
    own = BodyVector(start=place.start, is_place=True, name=name)
    pieces.point_on_point(pieces.add(place, 0), pieces.add(own, 1))
    of_face = [pieces.add(direction, 0) for direction in remote.directions]
    of_body = [pieces.add(BodyVector(start=e, name=name), 1) for e in np.eye(3)]
    for j, (i, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        pieces.perpendicular(of_face[i], of_body[k], f"turn {j + 1}")
    return pieces


def body_of(
    effect: Any, scene: Any, x: Array, v: Array, number: int
) -> tuple[RigidBody, BodyMotion]:
    """Data and motion of the body of a carried mass, as the nodes of its face move. Collective.

    Args:
        effect: The `PointMass`.
        scene: The problem.
        x: Places of owned nodes, shape (nodes, 3) [m].
        v: Their velocities, likewise [m/s].
        number: Number of the body.
    """
    remote, m = effect.remote, float(effect.mass)
    place = remote.place
    moving = [motion_at(scene, vector, x, v) for vector in (place, *remote.directions)]
    now, rates = np.asarray(moving).swapaxes(0, 1)
    R = now[1:].T
    omega = 0.5 * np.cross(now[1:], rates[1:]).sum(axis=0)
    none = np.empty(0, np.int32)
    data = RigidBody(
        name=effect.title,
        cells=none,
        nodes=none,
        offsets=np.empty((0, 3)),
        displacement=np.empty((0, 3)),
        mass=m,
        inertia=2 / 3 * m * (SMALL * place.face.size) ** 2 * np.eye(3),
        origin=now[0],
        number=number,
        given=True,
        extent=place.face.size,
    )
    return data, BodyMotion(now[0].copy(), R, rates[0], R.T @ omega)

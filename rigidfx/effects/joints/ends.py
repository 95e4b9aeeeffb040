"""Ends of springs: points of the ground, of rigid parts and of faces, mean places of sets."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.effects.base import Vector as Point
from rigidfx.effects.joints.averages import Average, Grounded
from rigidfx.effects.joints.checks import check_near, warn_of_arm
from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.sides import GROUND, Side, Surface, side_name, side_of

__all__ = ["end_of"]


def end_of(scene: Any, owner: str, side: Side, at: Point | None = None) -> Vector:
    """An end, for `RemoteNodes`. Collective.

    Args:
        scene: The problem.
        owner: Whose end it is, for messages.
        side: "ground", the name of a `Rigid` part or of a set, a `MeanFace` or a `RigidFace`.
        at: Place at the start [m]: needed of the ground; the centre of a part or a face if None.

    Raises:
        SceneError: On every rank, if there is no such part, surface or set.
    """
    given = None if at is None else np.asarray(at, dtype=np.float64)
    rigid = [effect.name for effect in scene.effects if effect.is_rigid]
    if isinstance(side, Surface) or side == GROUND or side in rigid:
        found = side_of(scene, owner, side)
        if isinstance(found, Grounded):
            assert given is not None
            return found.place(given)
        point = found.centre if given is None else given
        check_near(owner, side, found, point)
        warn_of_arm(scene, owner, side, found, point)
        return found.place(point)
    if given is not None:
        raise SceneError(
            f"{owner}: its end on {side_name(side)} is the mean place of the nodes of a set. Leave "
            "its place out, or name a Rigid part, a MeanFace or a RigidFace."
        )
    own = scene.nodes(side, owner)
    own = own[own < scene.owned_nodes].astype(np.int64)
    weights = np.full(own.size, 1.0 / scene.sum(own.size))
    point = np.asarray(scene.sum(weights @ scene.start_places[own]))
    return Average(own, weights, start=point, is_place=True)

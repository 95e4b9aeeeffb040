"""Sides that a joint may not join: one part with itself, held parts, surfaces far away."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.base.warning import warn
from rigidfx.effects.joints.averages import Grounded
from rigidfx.effects.joints.face_motion import Sided
from rigidfx.effects.joints.sides import Side, Surface, side_name
from rigidfx.effects.supports.support import Support

__all__ = ["check_near", "check_sides", "warn_of_arm"]


FAR = 20.0  # times its own size, that a surface may be away from its joint or remote point


def check_sides(
    scene: Any, owner: str, names: tuple[Side, ...], sides: tuple[Sided, ...], at: Array
) -> None:
    """Check the sides of a joint, or the face of a remote point, as far as possible. Collective.

    Args:
        scene: The problem.
        owner: The joint or effect, for messages.
        names: The sides as given.
        sides: The sides.
        at: Place of the joint at the start [m].

    Raises:
        SceneError: On every rank, if both are in one rigid part, if a support holds all of one, or
            if a surface is far away from the joint.
    """
    for name, side in zip(names, sides, strict=True):
        if isinstance(side, Grounded):
            continue
        check_near(owner, name, side, at, "its sides do not meet: " if len(sides) > 1 else "")
        for support in scene.named(Support):
            if len(support.axes) == 3 and _among(scene, side, support.where, support.kind):
                raise SceneError(
                    f"{owner}: {support.owner} holds all of {side_name(name)}. Join the 'ground' "
                    "in its place, or hold less."
                )
    grounded = len(sides) == 1 or any(isinstance(side, Grounded) for side in sides)
    for rigid in () if grounded else (e for e in scene.effects if e.is_rigid):
        if all(_among(scene, side, rigid.where, rigid.kind) for side in sides):
            raise SceneError(
                f"{owner}: both sides are of one part, {rigid.owner}, and cannot move against each "
                "other."
            )
    for name, side in zip(names, sides, strict=True):
        if not isinstance(side, Grounded):
            joined = len(sides) > 1 and isinstance(name, Surface)
            warn_of_arm(scene, owner, name, side, at, FAR / 4 if joined else FAR / 2)


def check_near(owner: str, name: Side, side: Any, at: Array, apart: str = "") -> None:
    """Refuse a point that is very far away from its surface.

    Args:
        owner: The joint or effect, for messages.
        name: The side as given.
        side: The side, not the ground.
        at: The point at the start [m].
        apart: Further words.

    Raises:
        SceneError: If it is very far away from a surface.
    """
    away = float(np.linalg.norm(at - side.centre))
    if isinstance(name, Surface) and round(away / side.size, 6) > FAR:
        raise SceneError(
            f"{owner}: {apart}it is at {_place(at)} m, and {side_name(name)} is around "
            f"{_place(side.centre)} m, {away:.3g} m away and {side.size:.3g} m large."
        )


def warn_of_arm(
    scene: Any, owner: str, name: Side, side: Any, at: Array, most: float = FAR / 2
) -> None:
    """Warn of a point that is far away from its side.

    A joint is expected on its surface. Remote points may be on arms, and so may joints of parts.
    The cells of parts of given mass or inertia may be anywhere.

    Args:
        scene: The problem.
        owner: The joint or effect, for messages.
        name: The side as given.
        side: The side, not the ground.
        at: The point at the start [m].
        most: The distance up to which nothing is said, in sizes of the side.
    """
    away = float(np.linalg.norm(at - side.centre))
    given = [rigid.name for rigid in scene.effects if rigid.is_rigid and rigid.given]
    if away > most * side.size and name not in given:
        warn(
            scene.comm,
            f"{owner}: it is at {_place(at)} m, {away:.3g} m away from the middle of "
            f"{side_name(name)}, which is {side.size:.3g} m large (root mean square): it moves "
            "with it as on a rigid arm. Check `at`, in metres, and the side.",
        )


def _among(scene: Any, side: Sided, where: str | None, kind: str) -> bool:
    """Whether all nodes of a side are in a set. Collective."""
    if where is None:
        return True
    outside = scene.members(where, kind)[side.nodes, 0] == 0.0
    return bool(scene.sum(np.count_nonzero(outside)) == 0)


def _place(x: Array) -> str:
    """A place, without the rounding of coordinates that are zero."""
    return f"({', '.join(f'{each:.4g}' for each in x.round(9) + 0.0)})"

"""The joints of a scene, with the motors that act, bound to a division."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigidfx.effects import (
    Joint,
    JointSpring,
    Motor,
    PointMass,
    Stop,
    Structure,
    Windowed,
)
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.remote import Points
from rigidfx.step.equations.actions import OwnMethods, bound


def elements_of(scene: Any, acting: Sequence[Windowed]) -> tuple[Motor | JointSpring | Stop, ...]:
    """Actions along free coordinates of joints: motors that act, springs and stops.

    Args:
        scene: The problem.
        acting: The effects with a time window that act.
    """
    here = {id(effect) for effect in acting}
    motors = [motor for motor in scene.named(Motor) if id(motor) in here]
    return (*motors, *scene.named(JointSpring), *scene.named(Stop))


def linked(structure: Structure, acting: Sequence[Windowed]) -> Linkage | None:
    """Joints, remote points and springs between points, bound; None without any. Collective.

    Args:
        structure: The division.
        acting: The effects with a time window that act.
    """
    scene = structure.scene
    joints = (*scene.named(Joint), *(e for e in scene.named(PointMass) if e.is_carried))
    points = _points_of(structure, acting)
    if not joints and not len(points):
        return None
    return Linkage(joints, elements_of(scene, acting), structure, points)


def _points_of(structure: Structure, acting: Sequence[Windowed]) -> Points:
    """Actions on points that depend on the motion. Collective."""
    here = {id(effect) for effect in acting}
    every = structure.scene.effects
    wanted = [e for e in every if not e.is_windowed or id(e) in here]
    pairs = [(e, bound(e, structure, "bind_points")) for e in wanted]
    owners = {id(action): effect.owner for effect, action in pairs if action is not None}
    actions = [action for _, action in pairs if action is not None]
    return Points(actions, OwnMethods(owners, structure.scene.comm).call)

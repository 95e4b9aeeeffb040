"""The joints of a scene, with the motors that act, bound to a division."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigidfx.effects import (
    Joint,
    JointSpring,
    Motor,
    PointMass,
    SpringDamper,
    Stop,
    Windowed,
)
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.on_face import OnFace, PointLaw
from rigidfx.state import State
from rigidfx.step.equations.structure import BoundStructure

__all__ = ["elements_of", "linked"]


def elements_of(scene: Any, acting: Sequence[Windowed]) -> tuple[Motor | JointSpring | Stop, ...]:
    """Actions along free coordinates of joints: motors that act, springs and stops.

    Args:
        scene: The problem.
        acting: The effects with a time window that act.
    """
    here = {id(effect) for effect in acting}
    motors = [motor for motor in scene.named(Motor) if id(motor) in here]
    return (*motors, *scene.named(JointSpring), *scene.named(Stop))


def linked(structure: BoundStructure, state: State, acting: Sequence[Windowed]) -> Linkage | None:
    """Joints, remote points and springs between points, bound; None without any. Collective.

    Args:
        structure: The division.
        state: The state.
        acting: The effects with a time window that act.
    """
    scene, rows = structure.scene, structure.rows
    joints = (*scene.named(Joint), *(e for e in scene.named(PointMass) if e.is_carried))
    laws = _laws_of(structure, acting)
    if not joints and not laws:
        return None
    bound = scene, rows, structure.own, state.bodies, state.u.x.array
    others = structure.notes, structure.static, laws
    return Linkage(joints, elements_of(scene, acting), *bound, *others)


def _laws_of(structure: BoundStructure, acting: Sequence[Windowed]) -> list[PointLaw]:
    """Forces on points that depend on the motion. Collective."""
    here = {id(effect) for effect in acting}
    every = structure.scene.named(OnFace)
    points = (e for e in every if not isinstance(e, Windowed) or id(e) in here)
    laws = [law for point in points if (law := point.law(structure)) is not None]
    return [*laws, *(spring.law_of(structure) for spring in structure.scene.named(SpringDamper))]

"""Sides of a joint: rigid parts, averaged faces, rigid faces, the ground."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.effects.joints.averages import Averages, Grounded
from rigidfx.effects.joints.face_motion import FaceSide, Sided

__all__ = [
    "GROUND",
    "MeanFace",
    "RigidFace",
    "Side",
    "Surface",
    "check_side",
    "rigid_faces",
    "side_name",
    "side_of",
]

GROUND = "ground"


@dataclass(frozen=True)
class Surface:
    """A surface as a side.

    Attributes:
        where: Name of a set of boundary facets, such as a hole.
    """

    where: str

    def __post_init__(self) -> None:
        """Check the name.

        Raises:
            SceneError: If it is none.
        """
        if not isinstance(self.where, str) or not self.where:
            raise SceneError(
                f"{type(self).__name__}: where must be the name of a set of facets, got "
                f"{shown(self.where)}."
            )

    @property
    def name(self) -> str:
        """Its name in messages and reports."""
        return f"{type(self).__name__} '{self.where}'"


@dataclass(frozen=True)
class MeanFace(Surface):
    """A surface that a joint holds by its mean position and the rotation that fits its nodes best.

    Nodes are weighted by areas. The joint's force is spread over the surface, which may deform
    (distributing coupling, RBE3).

    Attributes:
        where: Name of a set of boundary facets, such as a hole.
    """


@dataclass(frozen=True)
class RigidFace(Surface):
    """A surface whose nodes move as one rigid body (kinematic coupling, RBE2).

    It is stiffer than a real pin, and a `MeanFace` is softer. Stresses beside it are those of a
    glued pin. Its nodes have six unknowns. Cells round it become rigid all together or not at all.

    Attributes:
        where: Name of a set of boundary facets, such as a hole.
    """


Side = str | Surface


def check_side(owner: str, name: str, side: Any, named: str) -> None:
    """See whether something can be a side.

    Args:
        owner: The joint, for messages.
        name: Which of its sides, likewise.
        side: The given value.
        named: What a text may be but the ground, in words.

    Raises:
        SceneError: If it cannot.
    """
    if not isinstance(side, Surface) and not (isinstance(side, str) and side):
        raise SceneError(
            f"{owner}: {name} must be '{GROUND}', {named}, a MeanFace or a RigidFace, got "
            f"{shown(side)}."
        )


def side_name(side: Side) -> str:
    """A side in words."""
    return f"'{side}'" if isinstance(side, str) else side.name


def rigid_faces(effects: Iterable[Any]) -> tuple[RigidFace, ...]:
    """The rigid faces that effects take hold of, each once, in the order given."""
    sides = (side for effect in effects for side in getattr(effect, "sides", ()))
    return tuple(dict.fromkeys(side for side in sides if isinstance(side, RigidFace)))


def side_of(scene: Any, owner: str, side: Side) -> Sided:
    """A side as averages over nodes. Collective.

    Args:
        scene: The problem.
        owner: The joint, for messages.
        side: The side.

    Raises:
        SceneError: On every rank, if there is no such part or surface.
    """
    title, n = f"{owner}, {side_name(side)}", scene.owned_nodes
    if isinstance(side, Surface):
        weights = np.asarray(scene.facet_weights(side.where, owner)[:n])
        return FaceSide(scene, weights, title)
    if side == GROUND:
        return Grounded()
    rigid = {e.name: e.where for e in scene.effects if e.is_rigid}
    if side not in rigid:
        raise SceneError(
            f"{owner}: '{side}' is no Rigid part; there are {sorted(rigid) or 'none'}. A surface "
            f"is joined by MeanFace('{side}'), the ground is '{GROUND}'."
        )
    weights = np.array(scene.averaging_mass[:n])
    if rigid[side] is not None:
        weights *= scene.members(rigid[side], owner)[:n, 0]
    return Averages(scene, weights, title)

"""What a joint may join: rigid parts, averaged faces, the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import shown
from rigidfx.effects.joints.averages import Averages, Face, Grounded, Sided

__all__ = ["GROUND", "MeanFace", "Side", "check_side", "side_name", "side_of"]

GROUND = "ground"


@dataclass(frozen=True)
class MeanFace:
    """A surface that a joint takes hold of by its mean place and affine mean, weighted by areas.

    The joint's force is spread over the surface, which may deform (distributing coupling, RBE3).
    Directions that the nodes of a flat surface do not span are those of the cells behind it.

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
                f"MeanFace: where must be the name of a set of facets, got {shown(self.where)}."
            )


Side = str | MeanFace


def check_side(owner: str, name: str, side: Any) -> None:
    """See whether something can be a side.

    Args:
        owner: The joint, for messages.
        name: Which of its sides, likewise.
        side: What was given.

    Raises:
        SceneError: If it cannot.
    """
    if not isinstance(side, MeanFace) and not (isinstance(side, str) and side):
        raise SceneError(
            f"{owner}: {name} must be '{GROUND}', the name of a Rigid part or a MeanFace, got "
            f"{shown(side)}."
        )


def side_name(side: Side) -> str:
    """A side in words."""
    return f"'{side}'" if isinstance(side, str) else f"{type(side).__name__} '{side.where}'"


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
    if isinstance(side, MeanFace):
        surface = Averages(scene, scene.facet_weights(side.where, owner)[:n], title)
        if not surface.flat:
            return surface
        behind = np.unique(scene.boundary(side.where, owner)[:, 0]).astype(np.int32)
        return Face(surface, Averages(scene, scene.cell_weights(1.0, behind)[:n], title))
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

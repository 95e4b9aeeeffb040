"""Joints, springs and masses at points of faces: shapes do not know them yet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from rigidfx.base.errors import SceneError
from rigidfx.effects import Effect, Joint, Resultant, SpringDamper
from rigidfx.effects.joints.face_motion import Vector
from rigidfx.effects.joints.on_face import OnFace
from rigidfx.scene.scene import Scene
from rigidfx.shapes.responses import Responses

__all__ = ["refuse_joints"]


def refuse_joints(responses: Responses, nodes: npt.NDArray[np.int32], name: str) -> None:
    """See that none acts on a part, or on what it holds together with. Collective.

    Args:
        responses: Of the whole structure.
        nodes: Owned nodes of the part.
        name: Its name, for the message.

    Raises:
        SceneError: On every rank, if one does.
    """
    scene, part = responses.scene, responses.rigid.part
    own = np.concatenate(scene.comm.allgather(np.unique(part[nodes])))
    for effect, points in _linked(scene):
        if scene.sum(sum(int(np.isin(part[p.nodes], own).sum()) for p in points)):
            raise SceneError(
                f"Reduced '{name}': {effect.owner} acts on faces of it, or of parts that it holds "
                "together with. Reduced parts in machines come next: leave it flexible, or name it "
                "Rigid."
            )


def _linked(scene: Scene) -> Iterator[tuple[Effect, Sequence[Vector]]]:
    """Joints, springs and masses at points of faces, and between points, with the points."""
    for between in (*scene.named(Joint), *scene.named(SpringDamper)):
        yield between, between.averages
    for effect in (e for e in scene.named(OnFace) if e.face is not None):
        turning = isinstance(effect, Resultant) and not effect.is_dead
        if turning or getattr(effect, "is_carried", effect.is_lasting):
            yield effect, [effect.remote.place]

"""Forces of joints, and of springs and masses at points of faces: those that a face can bear."""

from collections.abc import Iterator

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.effects import Joint, SpringDamper
from rigidfx.effects.joints.remote import OnFace
from rigidfx.effects.joints.sides import FaceSide
from rigidfx.effects.joints.vectors import Vector, slopes_of
from rigidfx.scene.scene import Scene
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.samples import interleaved


def of_faces(responses: Responses) -> Array:
    """Unit forces on the points that joints and springs hold, and unit couples. Collective.

    A face whose turn matters has three forces and three couples, whatever the joint: parts turn
    against each other, and motors come and go. Those of all points in turn are in balance with
    inertia and of norm 1, shape (owned nodes, 3, k).
    """
    every = list(vectors(responses.scene))
    turned = [v.face for v in every if v.face is not None and not v.is_place]
    faces: dict[int, FaceSide] = {id(face): face for face in turned}
    known = {id(face.averages[0]) for face in faces.values()}
    each = [(face.nodes, face.unit_loads()) for face in faces.values()]
    for v in every:
        own = v if v.face is None else v.face
        if v.is_place and id(own) not in faces and id(own) not in known:
            known.add(id(own))
            each.append((v.nodes, slopes_of(v).swapaxes(1, 2)))
    return interleaved(responses, [_at(responses, *loads) for loads in each])


def _at(responses: Responses, nodes: Ints, loads: Array) -> Array:
    """Loads on some nodes as loads on all."""
    out = np.zeros((responses.scene.owned_nodes, 3, loads.shape[2]))
    out[nodes] = loads
    return out


def vectors(scene: Scene) -> Iterator[Vector]:
    """Points and directions that joints, springs and masses at points of faces act on."""
    for between in (*scene.named(Joint), *scene.named(SpringDamper)):
        yield from between.averages
    for effect in (e for e in scene.named(OnFace) if e.face is not None and e.follows):
        yield from (effect.remote.place, *effect.remote.directions)

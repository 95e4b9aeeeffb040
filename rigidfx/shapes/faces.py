"""Forces of joints, and of springs and masses at points: those that a face can bear."""

from collections.abc import Iterator

import numpy as np

from rigidfx.base.types import Array, Ints
from rigidfx.effects import Joint
from rigidfx.effects.joints.remote import OnFace
from rigidfx.effects.joints.sides import FaceSide
from rigidfx.effects.joints.vectors import Vector, slopes_of
from rigidfx.shapes.responses import Responses
from rigidfx.shapes.samples import interleaved
from rigidfx.step.equations.actions import bound


def of_faces(responses: Responses) -> Array:
    """Unit forces on the points that joints and springs hold, and unit couples. Collective.

    A face whose turn matters has three forces and three couples, whatever the joint: parts turn
    against each other, and motors come and go. Those of all points in turn are in balance with
    inertia and of norm 1, shape (owned nodes, 3, k).
    """
    every = list(vectors(responses))
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


def vectors(responses: Responses) -> Iterator[Vector]:
    """Points and directions that joints, springs and masses at points act on. Collective."""
    structure = responses.stiffness.structure
    for effect in responses.scene.effects:
        if isinstance(effect, Joint):
            yield from effect.averages
        elif isinstance(effect, OnFace):
            if effect.face is not None and effect.follows:
                yield from (effect.remote.place, *effect.remote.directions)
        elif (action := bound(effect, structure, "bind_points")) is not None:
            yield from action.nodes.ends

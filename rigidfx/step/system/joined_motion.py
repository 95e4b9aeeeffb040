"""Conditions of joints on small rigid motions of the connected parts of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rigidfx.base.matrices import dense
from rigidfx.base.types import Array, Ints
from rigidfx.effects import Joint, SpringDamper, Windowed
from rigidfx.effects.joints.averages import Vector
from rigidfx.effects.joints.elements import coordinate_of
from rigidfx.effects.joints.pieces import Terms
from rigidfx.step.system.linked import elements_of

__all__ = ["joint_rows"]


NOTHING = float(np.sqrt(np.finfo(np.float64).eps))  # of a motion: what asks less asks nothing


def joint_rows(scene: Any, acting: Sequence[Windowed], motions: Callable[[Ints], Array]) -> Array:
    """Rows that rigid motions fulfil which leave joints, locks, and springs beside. Collective.

    Args:
        scene: The problem.
        acting: The effects with a time window that act.
        motions: Displacements of owned nodes by the motions of all parts, shape (nodes, 3, n).

    Returns:
        Shape (rows, n), each of size one.
    """
    out: list[Array] = []
    joints = {joint.title: joint for joint in scene.named(Joint)}
    places, moved = {}, {}

    def look(vectors: Sequence[Vector]) -> tuple[Array, Array]:
        by = [np.einsum("nij,njm->im", a.slopes(), motions(a.nodes)) for a in vectors]
        return np.array([a.start for a in vectors]), np.asarray(scene.sum(by))

    for title, joint in joints.items():
        averages = joint.pieces.averages
        places[title], moved[title] = look(averages)
        terms = Terms([joint.pieces.rows], [0], len(averages))
        gradient = dense(terms.gradient(places[title]))
        out.append(gradient @ moved[title].reshape(gradient.shape[1], -1))
    for effect in elements_of(scene, acting):
        if effect.resists:
            joint, name = coordinate_of(scene, effect.owner, effect.joint, effect.acts_along)
            coordinate = joint.pieces.coordinates[name]
            at = list(coordinate.averages)
            slope = coordinate.gradient(places[joint.title][at]).reshape(1, -1)
            out.append(slope @ moved[joint.title][at].reshape(slope.size, -1))
    for spring in scene.named(SpringDamper):
        (a, b), by = look(spring.averages)
        if spring.taut:
            out.append(((b - a) @ (by[1] - by[0]))[None])
    none = motions(np.empty(0, np.int64))
    rows = np.concatenate([none.reshape(0, none.shape[2]), *out])
    sizes = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(np.divide(rows, sizes, out=np.zeros_like(rows), where=sizes > NOTHING))

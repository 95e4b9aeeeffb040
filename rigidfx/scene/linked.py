"""Connected parts that act on each other: by joints that link them, and by contacts."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.types import Bools, Ints
from rigidfx.effects import Contact
from rigidfx.effects.joints.joint import Between
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene

__all__ = ["linked", "met"]


def linked(scene: Scene) -> Ints:
    """Number of the group of each connected part, shape (parts,). Collective.

    Parts that a joint or a spring links are in one group.
    """
    nodes = [np.concatenate([a.nodes for a in own.averages]) for own in scene.named(Between)]
    holds = _held(scene, nodes)
    pairs = csr_array(holds.T.astype(np.float64) @ holds.astype(np.float64))
    return np.asarray(connected_components(pairs, directed=False)[1], dtype=np.int64)


def met(scene: Scene, contact: Contact) -> Bools:
    """Connected parts that a contact may touch, shape (parts,). Collective."""
    names = sorted({contact.where, *contact.keeps_apart})
    own = np.concatenate([scene.nodes(name, contact.owner, (2,)) for name in names])
    return np.asarray(_held(scene, [own[own < scene.owned_nodes]])[0])


def _held(scene: Scene, sets: list[Ints]) -> Bools:
    """Connected parts that each set of owned nodes of all ranks is in, shape (sets, parts)."""
    of_node, count = parts_of_nodes(scene), scene.parts.count
    here = [np.bincount(of_node[nodes], minlength=count) for nodes in sets]
    return np.asarray(scene.sum(np.reshape(here, (len(sets), count)).astype(np.float64)) > 0)

"""Shapes for nodes that contacts press, before these close.

A blow bends a body next to where it is struck in a way that no shape of smooth loads has. So each
node that presses for the first time gets a unit force along each direction in which a contact acts
on it, and the body gets the Ritz vectors of those forces that its own shapes do not span.
"""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_NODES, Remembered
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.effects import Contact
from rigidfx.scene.mesh_order import mesh_order
from rigidfx.scene.scene import Scene
from rigidfx.shapes.excess import About
from rigidfx.shapes.part import MOST
from rigidfx.shapes.ritz import DEPTH, RESOLVED, ritz


class Pressing:
    """Which nodes contacts have pressed, and unit forces on those that they press first."""

    remembered: ClassVar[Remembered] = {"_pressed": ON_NODES}

    def __init__(self, scene: Scene) -> None:
        """Nothing has been pressed."""
        self._scene, self._any = scene, bool(scene.named(Contact))
        self._pressed = np.zeros(scene.owned_nodes, dtype=bool)

    def new(self, pressing: tuple[Ints, Array]) -> tuple[Ints, Array] | None:
        """Owned nodes that are pressed for the first time, and how; None if none is. Collective.

        Contacts press owned nodes in directions of the shape (nodes, 3, 3), see `ContactForces`.
        """
        if not self._any:
            return None
        some = ~self._pressed[pressing[0]]
        nodes, ways = pressing[0][some], pressing[1][some]
        if not self._scene.sum(nodes.size):
            return None
        self._pressed[nodes] = True
        return nodes, ways

    def forget(self) -> None:
        """Begin anew: a new body has no shapes for those that press."""
        self._pressed[:] = False

    def loads(
        self, inside: Indices, R: Array, nodes: Ints, ways: Array
    ) -> tuple[Array, Array, bool]:
        """Forces on new nodes, as they act on a body with some nodes inside. Collective.

        Those on its own nodes are unit forces, unless they are more than `MOST`. Those and others,
        which reach it through cells that deform, act by their resultants: one and each coordinate
        are their weights. Nodes of the body have the order of the mesh file, so that shapes are the
        same on any ranks. The first result is along the main direction of each node, the second
        along the others, turned back by R, (owned nodes, 3, k); some may be zero. The third says
        whether all of the body's nodes have forces of their own.
        """
        scene, own = self._scene, np.isin(nodes, inside)
        each = int(scene.sum(np.count_nonzero(own))) <= MOST
        own &= each
        numbers = scene.comm.allgather(self._numbers[nodes[own]])
        first, every = sum(map(len, numbers[: scene.comm.rank])), np.concatenate(numbers)
        place = np.argsort(np.argsort(every, kind="stable"), kind="stable")
        f = ways @ R
        size = np.linalg.norm(f, axis=2, keepdims=True)
        f = np.divide(f, size, where=size > 0, out=np.zeros_like(f)).swapaxes(1, 2)
        F = np.zeros((scene.owned_nodes, 3, 3, every.size + 4))
        F[nodes[own], :, :, place[first : first + np.count_nonzero(own)]] = f[own]
        x = scene.space.tabulate_dof_coordinates()[nodes[~own]]
        sums = np.asarray(scene.sum(np.r_[x.sum(axis=0), len(x)]))
        weights = np.c_[np.ones(len(x)), (x - sums[:3] / max(sums[3], 1.0)) / scene.mean_cell_size]
        np.add.at(
            F[:, :, :, every.size :], nodes[~own], f[~own][:, :, :, None] * weights[:, None, None]
        )
        return F[:, :, 0], F[:, :, 1:].reshape(scene.owned_nodes, 3, -1), each

    @cached_property
    def _numbers(self) -> Ints:
        """Number of each node of this rank in the mesh file. Collective."""
        return mesh_order(self._scene).nodes


def vectors_for(
    about: About, modes: Array, stiffness: Array, F: Array, dt: float, room: int, follow: bool
) -> tuple[Array, int, bool]:
    """Vectors of the whole for the forces that a body's shapes do not span. Collective.

    They follow frequencies of a step of dt [s]. The vectors, (owned nodes, 3, k), how many of them
    are responses to forces, and whether there is room for all forces.
    """
    responses = about.responses
    F = responses.balanced(F)
    F = F[:, :, responses.act_on(about.part.nodes, F)]
    new, fits = about.unspanned(modes, stiffness, F, room)
    if not new.shape[2]:
        return new, 0, fits
    load = new, DEPTH if follow else 1
    vectors, n = ritz(responses, load, resolved=dt / RESOLVED, most=room)
    return vectors[:, :, :n], new.shape[2], fits

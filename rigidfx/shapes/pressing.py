"""Shapes for nodes that contacts press, before these close.

A blow bends a body next to where it is struck in a way that no shape of smooth loads has. So each
node that presses for the first time gets a unit force along each direction in which a contact acts
on it, and the body gets the Ritz vectors of those forces that its own shapes do not span.
"""

from functools import cached_property
from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import ON_NODES, Remembered
from rigidfx.base.types import Array, Ints
from rigidfx.effects import Contact
from rigidfx.scene.mesh_order import mesh_order
from rigidfx.scene.scene import Scene
from rigidfx.shapes.excess import About
from rigidfx.shapes.part import MOST
from rigidfx.shapes.ritz import DEPTH, RESOLVED, ritz

Known = tuple[Array, Array]  # Φ, shape (nodes, 3, m), and Ω of the shapes of a body


class Pressing:
    """Which nodes contacts have pressed, and unit forces on those that they press first.

    Attributes:
        pressed: Whether each owned node has been pressed.
    """

    remembered: ClassVar[Remembered] = {"pressed": ON_NODES}

    def __init__(self, scene: Scene) -> None:
        self._scene, self._any = scene, bool(scene.named(Contact))
        self.pressed = np.zeros(scene.owned_nodes, dtype=bool)

    def new(self, pressing: tuple[Ints, Array]) -> tuple[Ints, Array] | None:
        """Owned nodes that are pressed for the first time, and how; None if none is. Collective.

        Contacts press owned nodes in directions of the shape (nodes, 3, 3), see `ContactForces`.
        """
        if not self._any:
            return None
        some = ~self.pressed[pressing[0]]
        nodes, ways = pressing[0][some], pressing[1][some]
        if not self._scene.sum(nodes.size):
            return None
        self.pressed[nodes] = True
        return nodes, ways

    def forget(self) -> None:
        """Begin anew: a new body has no shapes for those that press."""
        self.pressed[:] = False

    def vectors(
        self, about: About, R: Array, new: tuple[Ints, Array], known: Known, dt: float, room: int
    ) -> tuple[list[tuple[Array, int]], bool]:
        """Vectors of the whole for forces that the known shapes of a body do not span. Collective.

        New nodes are as `new` tells them; R turns the body's frame at the start into space. Vectors
        follow frequencies of a step of dt [s]; followers take half of the room that forces leave.
        First those for the main direction of each node, then those for the others: vectors, shape
        (owned nodes, 3, k), and how many of them are responses to forces. And whether there is room
        for all forces.
        """
        responses, out, fits = about.responses, [], True
        for F, depth in zip(self._loads(about, R, *new), (DEPTH, 1), strict=True):
            F = responses.balanced(F)
            F = F[:, :, responses.act_on(about.part.nodes, F)]
            F, all_of_them = about.unspanned(*known, F, room)
            fits &= all_of_them
            if count := F.shape[2]:
                most, load = count + (room - count) // 2, (F, depth)
                found, n = ritz(responses, load, resolved=dt / RESOLVED, most=most, clean=True)
                out.append((found[:, :, :n], count))
                room = max(room - n, 0)
        return out, fits

    def _loads(self, about: About, R: Array, nodes: Ints, ways: Array) -> tuple[Array, Array]:
        """Forces on new nodes, as they act on a body. Collective.

        Those on its own nodes are unit forces, unless there are more than three for each shape that
        it may get. Then these, and in any case others in the same connected part, act by their
        resultants: one and each coordinate are their weights. Nodes of the body have the order of
        the mesh file, so that shapes are the same on any ranks. The first result is along the main
        direction of each node, the second along the others, turned back by R, (owned nodes, 3, k);
        some may be zero.
        """
        scene, part = self._scene, about.responses.rigid.part
        inside = np.isin(nodes, about.part.nodes)
        parts = np.concatenate(scene.comm.allgather(np.unique(part[about.part.nodes])))
        own = inside & (int(scene.sum(np.count_nonzero(inside))) <= 3 * MOST)
        others = ~own & np.isin(part[nodes], parts)
        numbers = scene.comm.allgather(self._numbers[nodes[own]])
        first, every = sum(map(len, numbers[: scene.comm.rank])), np.concatenate(numbers)
        place = np.argsort(np.argsort(every, kind="stable"), kind="stable")
        f = ways @ R
        size = np.linalg.norm(f, axis=2, keepdims=True)
        some = np.asarray(scene.sum(np.count_nonzero(size[:, :, 0], axis=0))) > 0
        f = np.divide(f, size, where=size > 0, out=np.zeros_like(f)).swapaxes(1, 2)[:, :, some]
        F = np.zeros((scene.owned_nodes, 3, f.shape[2], every.size + 4))
        F[nodes[own], :, :, place[first : first + np.count_nonzero(own)]] = f[own]
        x = scene.space.tabulate_dof_coordinates()[nodes[others]]
        sums = np.asarray(scene.sum(np.r_[x.sum(axis=0), len(x)]))
        weights = np.c_[np.ones(len(x)), (x - sums[:3] / max(sums[3], 1.0)) / scene.mean_cell_size]
        more = f[others][:, :, :, None] * weights[:, None, None]
        np.add.at(F[:, :, :, every.size :], nodes[others], more)
        return F[:, :, 0], F[:, :, 1:].reshape(scene.owned_nodes, 3, -1)

    @cached_property
    def _numbers(self) -> Ints:
        """Number of each node of this rank in the mesh file. Collective."""
        return mesh_order(self._scene).nodes

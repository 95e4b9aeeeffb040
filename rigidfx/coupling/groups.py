"""Groups of connected parts that bodies hold together, and the rigid motions of these.

A motion of a group is t and θ: its places x go to a + t + Q (x - a), with its centre a and the
rotation Q by the Cayley vector θ.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.types import Array, Bools, Ints
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import Body
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.mechanics.rotation import cayley
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene

HELD = float(np.sqrt(np.finfo(np.float64).eps))  # largest square of what supports hold, if nothing


@dataclass(frozen=True)
class Motions:
    """Motions that supports leave to groups where they are."""

    centres: Array  # a, shape (groups, 3) [m]
    each: Array  # t and θ of motions of size one, shape (groups, 6, n)
    even: Array  # combinations of these that have size one by mass, shape (n, n)


class Groups:
    """The groups of a scene with some bodies.

    Attributes:
        of_nodes: Group of each owned node.
        of_bodies: Group of each body.
    """

    def __init__(self, scene: Scene, bodies: Bodies, held: Bools) -> None:
        """Find them; supports hold some owned dofs, shape (nodes, 3). Collective."""
        self._scene, self._held = scene, held
        part = parts_of_nodes(scene)[: scene.owned_nodes]
        count, records = scene.parts.count, bodies.of.records
        own = [(k, p) for k, body in enumerate(records) for p in np.unique(part[body.nodes])]
        every = [pair for of_rank in scene.comm.allgather(own) for pair in of_rank]
        pairs, size = np.reshape(every, (-1, 2)).astype(np.int64), count + len(records)
        at = count + pairs[:, 0], pairs[:, 1]
        graph = coo_array((np.ones(len(pairs)), at), shape=(size, size))
        found, labels = connected_components(graph, directed=False)
        self._count, self.of_nodes, self.of_bodies = int(found), labels[part], labels[count:]
        alone = np.setdiff1d(np.arange(len(records)), pairs[:, 0])  # bodies without nodes
        self._alone: Ints = alone

    def motions(self, x: Array, bodies: Bodies) -> Motions:
        """Motions of groups whose owned nodes are at x, shape (nodes, 3) [m]. Collective."""
        of, m, total = self.of_nodes, self._scene.averaging_mass[: len(x)], self._scene.sum
        sums = np.zeros((self._count, 4))
        np.add.at(sums, of, m[:, None] * np.c_[np.ones(len(x)), x])
        sums = np.asarray(total(sums))
        for k in self._alone:
            sums[self.of_bodies[k]] = bodies.of.mass[k] * np.r_[1.0, bodies.r[k]]
        centres = sums[:, 1:] / sums[:, :1]
        R, blocks = rigid_motions(x - centres[of], 1.0), np.zeros((2, self._count, 6, 6))
        np.add.at(blocks[0], of, np.einsum("n,nai,naj->nij", m, R, R))
        np.add.at(blocks[1], of, np.einsum("nai,naj->nij", R * self._held[:, :, None], R))
        both: Array = np.asarray(total(blocks))
        mass, held, each = both[0], both[1], []
        for k in self._alone:
            sizes = np.r_[np.ones(3), np.full(3, bodies.of.length[k] ** 2)]
            mass[self.of_bodies[k]] = bodies.of.mass[k] * np.diag(sizes)
        for g in range(self._count):
            length = np.sqrt(np.trace(mass[g, 3:, 3:]) / (2 * sums[g, 0]))
            T = np.diag(np.r_[np.ones(3), np.full(3, 1 / length)])
            values, vectors = np.linalg.eigh(T @ held[g] @ T)
            each.append(np.zeros((self._count, 6, np.count_nonzero(values <= HELD))))
            each[g][g] = T @ vectors[:, values <= HELD]
        free = np.concatenate(each, axis=2)
        heavy = np.einsum("gin,gij,gjk->nk", free, mass, free)
        return Motions(centres, free, np.asarray(np.linalg.inv(np.linalg.cholesky(heavy)).T))

    def led(self, nodes: Ints, x: Array, motions: Motions) -> Array:
        """Velocities of nodes at x by each motion, shape (nodes, 3, n)."""
        of = self.of_nodes[nodes]
        return np.asarray(rigid_motions(x[nodes] - motions.centres[of], 1.0) @ motions.each[of])

    def turning(self, bodies: Bodies, which: list[int], motions: Motions, k: int) -> Bodies:
        """Some of the bodies, by numbers, with the velocities of a motion."""
        some, of = Bodies.of_each(bodies[n] for n in which), self.of_bodies[which]
        own = motions.each[of, :, k]
        v = own[:, :3] + np.cross(own[:, 3:], some.r - motions.centres[of])
        W = np.einsum("bij,bi->bj", some.R, own[:, 3:])
        return some.moving(v, W, np.zeros_like(some.q_rate))

    def gone(self, x: Array, bodies: Bodies, motions: Motions, by: Array) -> tuple[Array, Bodies]:
        """Places of nodes and bodies after so much of each motion, shape (n,)."""
        c, of = motions.each @ by, self.of_nodes
        Q = np.stack([cayley(own[3:]) for own in c])
        turned = np.einsum("nij,nj->ni", Q[of], x - motions.centres[of])
        each = []
        for body, g in zip(bodies, self.of_bodies, strict=True):
            motion, a = body.motion, motions.centres[g]
            r, R = a + c[g, :3] + Q[g] @ (motion.r - a), Q[g] @ motion.R
            each.append(Body(body.data, replace(motion, r=r, R=R)))
        goal = (motions.centres + c[:, :3])[of] + turned
        return np.where(self._held, x, goal), Bodies.of_each(each)

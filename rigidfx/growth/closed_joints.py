"""Places that keep joints closed where nodes have moved.

Nodes that move by δ open joints by g. Groups of connected parts that bodies hold together move on
by rigid motions R c, and joints strain them by forces N λ that have no resultant on any group:

    g + D (R c - G λ) = 0 ,    (D R)ᵀ N = 0 ,    G = K⁺ Dᵀ N ,

with the derivatives D by places of the rows of joints, and of motors that prescribe a motion. c is
the least one by mass. Rotations are finite: g is evaluated anew until it is rounding.
"""

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np

from rigidfx.base.types import Array
from rigidfx.coupling.groups import Groups, Motions
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Structure, Windowed
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.nodes import ForcesOfNodes
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.rigid_body import outside
from rigidfx.mechanics.rigid_motions import best_motion
from rigidfx.scene.points import parts_of_nodes
from rigidfx.scene.scene import Scene
from rigidfx.shapes.responses import ROUNDING, Responses
from rigidfx.state import State
from rigidfx.step.equations.constraints import linked
from rigidfx.step.equations.supports import PrescribedDofs, supports_of

LEAST = 0.01  # way of joints per motion of groups, below which joints are closed by strains


@dataclass(frozen=True)
class Moved:
    """Where nodes and bodies have gone."""

    d: Array  # how far the owned nodes have moved, shape (nodes, 3) [m]
    bodies: Bodies  # all bodies, as their groups have moved
    energy: float  # gained by springs of joints [J]


@dataclass(frozen=True)
class Strains:
    """How joints close: rows in columns, shape (rows, k), of which each k is of size one."""

    V: Array  # by motions of groups
    N: Array  # by forces that have next to no resultant on any group
    G: Array  # displacement of nodes by these, shape (nodes, 3, k) [m/N]
    stiffness: Array  # of joints against these forces, shape (k, k) [N/m]


class ClosedJoints:
    """Joints of a state in which bodies leave their shapes, whose nodes move by themselves."""

    def __init__(
        self,
        scene: Scene,
        state: State,
        leaving: Set[int],
        acting: Sequence[Windowed],
        responses: Responses,
    ) -> None:
        """Bind joints of a state that is up to date; bodies leave by their numbers. Collective.

        Responses are those about the start.
        """
        self._scene, self._bodies = scene, state.bodies
        held = PrescribedDofs(scene, supports_of(acting)).mask.reshape(-1, 3)
        self._responses = responses
        self._stay = [k for k, b in enumerate(state.bodies.of.records) if b.number not in leaving]
        bodies = self._staying(state.bodies)
        own = outside(scene.owned_nodes, bodies.of.records)
        self._free = ~held & own[:, None]
        self._X, self._u = state.X[: own.size], state.u.x.array.copy()
        self._begun: Array = np.array(state.places)
        rows = Rows(scene.space, np.arange(own.size, dtype=np.int32))
        notes = state.notes
        structure = Structure(
            scene=scene, rows=rows, own=own, bodies=bodies, mass=None, u=self._u, notes=notes
        )
        linkage = linked(structure, acting)
        assert linkage is not None
        self._linkage: Linkage = linkage
        self._groups = Groups(scene, state.bodies, held)

    def _staying(self, bodies: Bodies) -> Bodies:
        return Bodies.of_each(bodies[k] for k in self._stay)

    def moved(self, d: Array) -> Moved | None:
        """Where all go as nodes move by d, (nodes, 3) [m]; None if joints stay open. Collective."""
        begun, bodies = self._begun, self._bodies
        wanted, _ = self._rows(begun, bodies)
        stored = self._linkage.stored(self._staying(bodies))
        x, before, strains = begun + d, np.inf, None
        g, D = self._rows(x, bodies)
        while 0.0 < (size := float(np.abs(g - wanted).max(initial=0.0))) < 0.5 * before:
            before = size
            motions = self._groups.motions(x, bodies)
            A = D @ self._led(x, bodies, motions)
            strains = self._strains(A, D, x) if strains is None else strains
            y = strains.stiffness @ (strains.N.T @ (g - wanted))
            left = strains.V.T @ (D @ (self._averages(strains.G) @ y) - (g - wanted))
            c = motions.even @ np.linalg.lstsq(strains.V.T @ A @ motions.even, left)[0]
            x, bodies = self._groups.gone(x - strains.G @ y, bodies, motions, c)
            g, D = self._rows(x, bodies)
        if size > ROUNDING * self._scene.parts.extent:
            return None
        gained = self._linkage.stored(self._staying(bodies)) - stored
        return Moved(x - begun, bodies, gained)

    def kept(self, e: Array) -> Array:
        """A small displacement of the start, (nodes, 3) [m], as joints keep it. Collective.

        Groups go by rigid motions that close joints; of these, by those with which springs of
        joints keep their forces, as e rests or varies slowly; of these, by the least one by mass.
        """
        x, bodies = self._begun, self._bodies
        motions, (_, D) = self._groups.motions(x, bodies), self._rows(x, bodies)
        d: Array = np.einsum("nab,nb->na", self._turns(x), e)
        by_c, by_d = self._led(x, bodies, motions), self._averages(d[:, :, None])[:, 0]
        free, c, springs = motions.even, np.zeros(len(motions.even)), self._linkage.sprung()
        U, sizes, V = np.linalg.svd(D @ by_c @ free)
        n = np.count_nonzero(sizes > LEAST * sizes.max(initial=0.0))
        c -= free @ V[:n].T @ (U[:, :n].T @ D @ by_d / sizes[:n])
        free = free @ V[n:].T
        c -= free @ np.linalg.lstsq(springs @ by_c @ free, springs @ (by_d + by_c @ c))[0]
        return np.asarray(d + self._groups.led(np.arange(len(x)), x, motions) @ c)

    def _rows(self, x: Array, bodies: Bodies) -> tuple[Array, Array]:
        """g of all rows where nodes are at x, shape (rows,) [m], and D by averages. Collective."""
        self._u[: x.size] = (x - self._X).reshape(-1)
        self._linkage.begin(self._staying(bodies))
        return self._linkage.bound()

    def _averages(self, fields: Array) -> Array:
        """Averages of fields that bodies do not move with, shape (3 · averages, k). Collective."""
        mean, rows = self._linkage.averages.mean, self._linkage.averages.rows
        each = [mean(fields[rows, :, k]).ravel() for k in range(fields.shape[2])]
        return np.stack(each, axis=1) if each else np.zeros((3 * self._linkage.used.size, 0))

    def _led(self, x: Array, bodies: Bodies, motions: Motions) -> Array:
        """Averages of motions of groups, shape (3 · averages, n). Collective."""
        averages, v = self._linkage.averages, np.zeros_like(x)
        fields = self._groups.led(averages.rows, x, motions)
        out = np.zeros((3 * self._linkage.used.size, fields.shape[2]))
        for k in range(fields.shape[2]):
            v[averages.rows] = fields[:, :, k]
            turning = self._groups.turning(bodies, self._stay, motions, k)
            out[:, k] = averages.velocities(v, turning).ravel()
        return out

    def _strains(self, A: Array, D: Array, x: Array) -> Strains:
        """Which rows close by motions of size 1, A, and how joints strain groups. Collective."""
        U, values, _ = np.linalg.svd(A)
        rank = np.count_nonzero(values > LEAST)
        V, N = U[:, :rank], U[:, rank:]
        G = self._strained(D.T @ N, x)
        yields = N.T @ D @ self._averages(G)
        return Strains(V, N, G, np.asarray(np.linalg.pinv(yields, hermitian=True)))

    def _strained(self, forces: Array, x: Array) -> Array:
        """Nodes by K⁺ of forces on averages, (3 · averages, k), shape (nodes, 3, k). Collective."""
        F = np.zeros((*x.shape, forces.shape[1]))
        for k, own in enumerate(forces.T):
            self._linkage.averages.add(own.reshape(-1, 3), ForcesOfNodes(F[:, :, k]))
        Q = self._turns(x)
        found = self._responses.solve(np.einsum("nba,nbk->nak", Q, F))
        return np.einsum("nab,nbk->nak", Q, found) * self._free[:, :, None]

    def _turns(self, x: Array) -> Array:
        """Rotations of connected parts since the start, by owned nodes. Collective."""
        start, part, turns = self._responses.stiffness.places, parts_of_nodes(self._scene), []
        for number in range(self._scene.parts.count):
            some = part[: len(x)] == number
            turns.append(best_motion(start[some], x[some], self._scene.sum)[0])
        return np.stack(turns)[part[: len(x)]]

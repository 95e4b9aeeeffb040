"""All joints of a division: where their averages are, their rows, and the forces of these.

Averages are p = W x over nodes that are no body's, plus those of nodes in bodies, which move as
[1, V] times the bodies' poses. With g at most quadratic in p,

    g(x₁) = g(x₀) + ∇g(p½) · Δp    exactly,

so that forces λ ∇g(p½) do no work where g is zero at both ends, and have no resultant, as g does
not see rigid motions. g(x₁) is computed like that, from increments: what rounding leaves of places
is the same in all iterates of a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import csr_array

from rigidfx.effects.joints.joint import Joint
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments

__all__ = ["Linkage"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Linkage:
    """The joints of a scene, bound to a division; arrays are equal on all ranks.

    Attributes:
        count: Number of rows.
        averages: Number of averages.
        masses: Mass that each row moves, in order of magnitude [kg].
        multipliers: λ of each row in the last step, shape (rows,) [N].
        own: Weights of nodes that are no body's, shape (averages, places among these nodes).
        held: Weights of the bodies' [1, V], shape (averages, 4 · bodies).
        at: Places of the nodes of `own` among the rows of the division.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        scene: Any,
        rows: Any,
        own: npt.NDArray[np.bool_],
        bodies: Bodies,
        u: Array,
        notes: dict[int, Any] | None = None,
    ) -> None:
        """Bind joints to nodes and bodies. Collective.

        Args:
            joints: The joints, as the scene has placed them.
            scene: The problem.
            rows: Rows of the nodes that take part.
            own: For each of these nodes, whether it belongs to no body.
            bodies: The rigid bodies.
            u: Displacements of all local dofs at the start of a step [m], changed by each step.
            notes: What joints remember from division to division, by their identity.
        """
        self._comm: MPI.Intracomm = scene.comm
        self._joints, self._notes = tuple(joints), notes
        pieces = [joint.pieces for joint in joints]
        firsts = [0, *accumulate(len(own.averages) for own in pieces)]
        averages = [average for own in pieces for average in own.averages]
        self.averages, self.count = len(averages), sum(len(own.rows) for own in pieces)
        self.masses = np.repeat([own.mass for own in pieces], [len(own.rows) for own in pieces])
        self._constant = np.reshape([average.constant for average in averages], (-1, 3))
        number = np.repeat(np.arange(self.averages), [a.nodes.size for a in averages])
        nodes = np.concatenate([np.empty(0, np.int64), *(a.nodes for a in averages)])
        weights = np.concatenate([np.empty(0), *(a.weights for a in averages)])
        W = csr_array((weights, (number, nodes)), shape=(self.averages, scene.owned_nodes))
        self.at = np.flatnonzero(own & (np.diff(W.tocsc().indptr)[rows.nodes] > 0))
        self.own = W[:, rows.nodes[self.at]].tocsr()
        held = [
            W[:, body.nodes] @ np.c_[np.ones(body.nodes.size), body.offsets]
            for body in bodies.of.records
        ]
        every = np.reshape(held, (-1, self.averages, 4)).swapaxes(0, 1)
        self.held = csr_array(np.asarray(scene.sum(every)).reshape(self.averages, -1))
        self._X, self._dofs = rows.X[self.at], rows.dofs.reshape(-1, 3)[self.at]
        self._u0 = u
        self._set_rows(firsts)
        self._known = [slice(*pair) for pair in self._ends()]
        self.multipliers: Array = np.zeros(self.count)
        for joint, place in zip(self._joints, self._known, strict=True):
            before = (self._notes or {}).get(id(joint))
            if before is not None:
                self.multipliers[place] = before
        none: Array = np.zeros((self.averages, 3))
        self._start, self._moved, self.forces = none, none, none
        self._g0: Array = np.zeros(self.count)

    def _set_rows(self, firsts: Sequence[int]) -> None:
        """Collect the terms of all rows."""
        linear: list[tuple[int, int, float]] = []
        products: list[tuple[int, int, int, float]] = []
        row = 0
        for joint, first in zip(self._joints, firsts, strict=False):
            for item in joint.pieces.rows:
                linear += [(row, 3 * (first + k) + axis, c) for k, axis, c in item.linear]
                products += [(row, first + k, first + j, c) for k, j, c in item.products]
                row += 1
        shape = self.count, 3 * self.averages
        at = np.array([(r, c) for r, c, _ in linear], dtype=np.int64).reshape(-1, 2).T
        self._linear = csr_array((np.array([v for *_, v in linear]), at), shape=shape)
        pairs = np.array([(r, k, j) for r, k, j, _ in products], dtype=np.int64).reshape(-1, 3)
        self._row, self._first, self._second = pairs.T
        self._factor = np.array([c for *_, c in products])
        columns = 3 * pairs[:, 1:, None] + np.arange(3)
        self._at = np.broadcast_to(self._row[:, None, None], columns.shape).ravel(), columns.ravel()

    def _ends(self) -> list[tuple[int, int]]:
        """First and last row of each joint."""
        last = np.cumsum([len(joint.pieces.rows) for joint in self._joints])
        return list(zip([0, *last[:-1]], last, strict=True))

    # Where averages are ---------------------------------------------------------------------------

    def _average(self, of_nodes: Array, of_bodies: Array) -> Array:
        """Averages of vectors at nodes and of matrices of bodies, shape (averages, 3). Collective.

        Args:
            of_nodes: Of the nodes of `own`, shape (nodes, 3).
            of_bodies: Shape (bodies, 4, 3).
        """
        out = np.asarray(self.own @ of_nodes)
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out + self.held @ of_bodies.reshape(-1, 3)

    def rates(self, v: Array) -> Array:
        """ġ of nodes that are no body's, at the start of a step, shape (rows,) [m/s]. Collective.

        Args:
            v: Velocities of the division's rows, one number each [m/s].
        """
        at_nodes = v.reshape(-1, 3)[self.at]
        none: Array = np.zeros((self.held.shape[1], 3))
        return np.asarray(self.gradient(0.0) @ self._average(at_nodes, none).ravel())

    def begin(self, bodies: Bodies) -> None:
        """Begin a step: find where averages are. Collective.

        Args:
            bodies: The bodies at its start.
        """
        x = self._X + self._u0[self._dofs]
        self._start = self._average(x, bodies.pose) + self._constant
        p = self._start
        self._g0 = self._linear @ p.ravel() + self._products(p, p)

    def _products(self, p: Array, q: Array) -> Array:
        """Σ s p_k · q_l of each row."""
        values = self._factor * (p[self._first] * q[self._second]).sum(axis=1)
        return np.asarray(np.bincount(self._row, values, minlength=self.count), dtype=np.float64)

    def look(self, d: Any, increments: Increments, multipliers: Array) -> None:
        """See an iterate. Collective.

        Args:
            d: Increments of the nodes of the division's rows.
            increments: Those of the bodies.
            multipliers: λ there [N].
        """
        self.multipliers = multipliers
        moved = d.array_r.reshape(-1, 3)[self.at]
        self._moved = self._average(moved, increments.displacement)
        self.forces = (self.gradient(0.5).T @ multipliers).reshape(-1, 3)

    @property
    def violation(self) -> Array:
        """g at the end of the step, shape (rows,) [m]."""
        p, d = self._start + 0.5 * self._moved, self._moved
        gained = self._linear @ d.ravel() + self._products(p, d) + self._products(d, p)
        return np.asarray(self._g0 + gained)

    def gradient(self, share: float) -> csr_array:
        """∂g/∂p after a part of the step, shape (rows, 3 · averages).

        Args:
            share: 0.5 for the middle of the step, 1 for its end.
        """
        if not self._row.size:
            return self._linear
        p = self._start + share * self._moved
        both = self._factor[:, None, None] * np.stack([p[self._second], p[self._first]], axis=1)
        return self._linear + csr_array((both.ravel(), self._at), shape=self._linear.shape)

    def curvature(self) -> csr_array:
        """Derivative of the forces on averages by these, shape (3 · averages,) * 2 [N/m]."""
        value = 0.5 * self.multipliers[self._row] * self._factor
        axes = np.arange(3)
        k, j = (3 * of[:, None] + axes for of in (self._first, self._second))
        row, column = np.r_[k.ravel(), j.ravel()], np.r_[j.ravel(), k.ravel()]
        size = 3 * self.averages
        values = np.tile(np.repeat(value, 3), 2)
        return csr_array((values, (row, column)), shape=(size, size))

    # Forces ---------------------------------------------------------------------------------------

    def resist_nodes(self, f: Any) -> None:
        """Add the forces on nodes that are no body's."""
        f.array.reshape(-1, 3)[self.at] += self.own.T @ self.forces

    def moments(self, bodies: int) -> Array:
        """Σ f and Σ V fᵀ on each body, shape (bodies, 4, 3)."""
        return np.asarray(self.held.T @ self.forces).reshape(bodies, 4, 3)

    def resistance_at(self, nodes: npt.NDArray[np.int32], forces: Array) -> None:
        """Add the forces on owned nodes, in bodies or not, to those that are given [N].

        Args:
            nodes: The nodes, sorted.
            forces: Shape (nodes, 3).
        """
        averages = (a for joint in self._joints for a in joint.pieces.averages)
        for average, force in zip(averages, self.forces, strict=True):
            place = np.searchsorted(nodes, average.nodes)
            place[place == nodes.size] = 0
            here = nodes[place] == average.nodes if nodes.size else np.zeros(0, dtype=bool)
            forces[place[here]] += average.weights[here, None] * force

    def accept(self) -> None:
        """Remember the multipliers for later divisions."""
        if self._notes is not None:
            for joint, place in zip(self._joints, self._known, strict=True):
                self._notes[id(joint)] = self.multipliers[place]

"""Nodes whose forces depend on each other, wherever they are: on any rank, flexible or in bodies.

An effect between two places, such as a contact between surfaces, needs both of them at once. The
few nodes that take part are numbered, and their positions, displacements and forces are known on
all ranks. A node of a body moves by a = [1, V] times the body's matrix of increments, so that
forces on it enter the body's six unknowns by Σ f and Σ V fᵀ.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import csr_array

from rigidfx.effects.action import Structure
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments
from rigidfx.mechanics.rotation import cross

__all__ = ["LinkedNodes"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class LinkedNodes:
    """Some nodes of a division; arrays over all of them are equal on all ranks.

    Attributes:
        size: How many there are.
        bodies: Of each the body that it is in, -1 if none, shape (size,).
        in_one_body: Whether all are in the same body, and so cannot move against each other.
    """

    def __init__(
        self, structure: Structure, nodes: npt.NDArray[Any], numbers: Ints, size: int
    ) -> None:
        """Find which nodes are whose. Collective.

        Args:
            structure: The division.
            nodes: Owned ones of them on this rank.
            numbers: The number of each, from 0 on.
            size: How many there are on all ranks.
        """
        scene, rows, records = structure.scene, structure.rows, structure.bodies.of.records
        self._comm: MPI.Intracomm = scene.comm
        self.size, self._u0 = size, structure.u
        places = np.full(scene.owned_nodes, -1)
        places[rows.nodes[structure.own]] = np.flatnonzero(structure.own)
        mine = places[nodes] >= 0
        self._at, self._at_numbers = places[nodes[mine]], numbers[mine]
        self._X = rows.X[self._at]
        self._dofs = rows.dofs.reshape(-1, 3)[self._at]
        number_of = np.full(scene.owned_nodes, -1)
        number_of[nodes] = numbers
        held = [number_of[body.nodes] for body in records]
        pairs = list(zip(records, held, strict=True))
        self._of = np.repeat(np.arange(len(held)), [int((own >= 0).sum()) for own in held])
        self._of_numbers = np.concatenate([np.empty(0, np.int64), *(o[o >= 0] for o in held)])
        coordinates = [np.c_[np.ones(body.nodes.size), body.offsets][o >= 0] for body, o in pairs]
        self._a = np.concatenate([np.empty((0, 4)), *coordinates])
        of = self._everywhere(self._of_numbers, self._of[:, None] + 1.0)[:, 0]
        self.bodies: Ints = of.astype(np.int64) - 1
        self._coordinates = self._everywhere(self._of_numbers, self._a)
        self.in_one_body = bool((self.bodies >= 0).all() and np.ptp(self.bodies) == 0)
        self._unknowns: Ints | None = None

    def _everywhere(self, numbers: Ints, values: Array) -> Array:
        """Values of all nodes from those of this rank, zero where there are none. Collective."""
        out = np.zeros((self.size, *values.shape[1:]))
        out[numbers] = values
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out

    def _of_all(self, of_nodes: Array, of_bodies: Array) -> Array:
        """Vectors of all nodes, from those at rows and those of nodes in bodies. Collective."""
        numbers = np.r_[self._at_numbers, self._of_numbers]
        return self._everywhere(numbers, np.concatenate([of_nodes, of_bodies]))

    def _follow(self, matrices: Array) -> Array:
        """Vectors of this rank's nodes in bodies, from matrices of the bodies, shape (·, 4, 3)."""
        return np.asarray((self._a[:, None] @ matrices[self._of])[:, 0])

    # Where they are -----------------------------------------------------------------------------

    def positions(self, bodies: Bodies) -> Array:
        """Positions at the start of a step, shape (size, 3) [m]. Collective."""
        return self._of_all(self._X + self._u0[self._dofs], self._follow(bodies.pose))

    def positions_at(self, u: Array, bodies: Bodies) -> Array:
        """Positions at displacements of the rows, likewise. Collective."""
        return self._of_all(self._X + u.reshape(-1, 3)[self._at], self._follow(bodies.pose))

    def moved(self, d: Any, increments: Increments) -> Array:
        """Displacements in a step at an iterate, shape (size, 3) [m]. Collective."""
        return self._of_all(
            d.array_r.reshape(-1, 3)[self._at], self._follow(increments.displacement)
        )

    def velocities(self, v: Array, bodies: Bodies) -> Array:
        """Velocities at those of the rows, shape (size, 3) [m/s]. Collective."""
        arms = self._follow(bodies.pose) - bodies.r[self._of]
        turning = cross(bodies.angular_velocity[self._of], arms)
        return self._of_all(v.reshape(-1, 3)[self._at], bodies.velocity[self._of] + turning)

    # What forces on them do ---------------------------------------------------------------------

    def resist_nodes(self, force: Array, f: Any) -> None:
        """Add forces, shape (size, 3) [N], to those of the rows' nodes in no body."""
        f.array.reshape(-1, 3)[self._at] += force[self._at_numbers]

    def moments(self, force: Array, count: int) -> Array:
        """Σ f and Σ V fᵀ of forces on each of so many bodies, shape (count, 4, 3). Collective."""
        out = np.zeros((count, 4, 3))
        own = force[self._of_numbers]
        np.add.at(out, self._of, self._a[:, :, None] * own[:, None])
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, out)
        return out

    def derivatives(self, nodes: Ints, G: Array, prolongation: Any) -> tuple[csr_array, csr_array]:
        """Derivatives of scalars by the unknowns, test side and trial side. Collective.

        Args:
            nodes: Nodes that each scalar depends on, shape (n, k).
            G: Its derivatives by their displacements, shape (n, k, 3).
            prolongation: Map between unknowns and dofs.

        Returns:
            By the bodies' L and by their P: a stiffness s of the scalars adds Lᵀ s P to a tangent.
        """
        if self._unknowns is None:
            self._unknowns = self._numbered(prolongation)
        L, P = prolongation.increments.L, prolongation.increments.P
        return self._by(L, nodes, G, prolongation), self._by(P, nodes, G, prolongation)

    def _numbered(self, prolongation: Any) -> Ints:
        """Unknown of each dof of all nodes, -1 where there is none, shape (size, 3). Collective."""
        own = prolongation.numbers.reshape(-1, 3)[self._at] + 1.0
        return self._everywhere(self._at_numbers, own).astype(np.int64) - 1

    def _by(self, M: Array, nodes: Ints, G: Array, prolongation: Any) -> csr_array:
        """Derivatives of scalars, M being L or P of the bodies, shape (bodies, 12, 6)."""
        assert self._unknowns is not None
        scalar = np.broadcast_to(np.arange(len(nodes))[:, None], nodes.shape)
        alone = self.bodies[nodes] < 0
        columns = [self._unknowns[nodes[alone]].reshape(-1)]
        values = [G[alone].reshape(-1)]
        rows = [np.repeat(scalar[alone], 3)]
        if not alone.all():
            held = nodes[~alone]
            of = self.bodies[held]
            moves = M.reshape(-1, 4, 3, 6)[of]
            moved = np.einsum("na,naij,ni->nj", self._coordinates[held], moves, G[~alone])
            columns.append(prolongation.body_columns[of].reshape(-1))
            values.append(moved.reshape(-1))
            rows.append(np.repeat(scalar[~alone], 6))
        row, column, value = (np.concatenate(part) for part in (rows, columns, values))
        known = column >= 0
        shape = len(nodes), prolongation.size
        return csr_array((value[known], (row[known], column[known])), shape=shape)

"""Iterates and nodes as effects see them, and where these hand in forces and stiffness.

A node of a body has constant body-fixed coordinates a, shape (n,), and moves by a · D with one
matrix D of the body, shape (n, 3). Forces on nodes enter the body by their moments Σ a fᵀ, and a
stiffness of nodes by the derivative of these moments. Actions add what this rank's nodes have;
what all ranks know counts on the first one (`Structure.once`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.sparse import csr_array, diags_array

from rigidfx.base.matrices import Matrix, compact
from rigidfx.base.types import Array, Ints
from rigidfx.effects.action import Structure
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Increments


@dataclass(frozen=True)
class Instant:
    """A state of bodies and of rows at t [s]; displacements are those at a step's start if None."""

    bodies: Bodies
    u: Array | None = None
    t: float = float("nan")


@dataclass(frozen=True)
class Motion:
    """An iterate of a step."""

    d: Any  # increments of the nodes of the rows, a PETSc vector [m]
    increments: Increments  # those of the bodies
    dt: float  # length of the step [s]; of no meaning in statics
    begun: Instant | None = None  # its start, the same object as long as nothing of it changes

    @property
    def start(self) -> Instant:
        """The start of the step."""
        return Instant(self.increments.start) if self.begun is None else self.begun

    @property
    def array_r(self) -> Array:
        """Increments of the rows, one number each [m]."""
        return np.asarray(self.d.array_r)

    @property
    def nodes(self) -> Array:
        """The same, shape (nodes, 3) [m]."""
        return self.array_r.reshape(-1, 3)

    @property
    def finite(self) -> bool:
        """Whether it is finite on this rank: an iteration may run away."""
        every = self.array_r, self.increments.unknowns
        return all(bool(np.isfinite(values).all()) for values in every)


@dataclass(frozen=True)
class Forces:
    """Forces on nodes and bodies, which actions add to."""

    vector: Any  # on the nodes of the rows, a PETSc vector [N]
    moments: Array  # Σ a fᵀ of this rank's forces on each body, shape (bodies, n, 3) [N, N m]
    torques: Array  # on the bodies as such, shape (bodies, 3) [N m]

    @classmethod
    def none(cls, vector: Any, pose: Array | None = None) -> Forces:
        """Forces on a vector as it is, and none on bodies with places `pose`, (bodies, n, 3)."""
        pose = np.empty((0, 1, 3)) if pose is None else pose
        return cls(vector, np.zeros(pose.shape), np.zeros((len(pose), 3)))

    @property
    def nodes(self) -> Array:
        """On the nodes of the rows, shape (nodes, 3) [N]."""
        return np.asarray(self.vector.array.reshape(-1, 3))

    @property
    def parts(self) -> tuple[Array, ...]:
        """All of them."""
        return self.vector.array, self.moments, self.torques

    def scale(self, factor: float) -> None:
        """Multiply all of them."""
        for part in self.parts:
            part *= factor

    def add(self, at: Any, forces: Array) -> None:
        """Add forces on some `Nodes` of this rank, shape (nodes, 3) [N]."""
        count = at.rows.size
        self.nodes[at.rows] += forces[:count]
        if count < len(forces):
            self.moments[...] += at.gather(forces[count:])


@dataclass(frozen=True)
class ForcesOfNodes:
    """Forces on all owned nodes of this rank, in bodies or not, shape (owned nodes, 3) [N]."""

    nodes: Array

    def add(self, at: Any, forces: Array) -> None:
        """Add forces on some `Nodes` of this rank, shape (nodes, 3) [N]."""
        self.nodes[at.nodes] += forces


class Tangent:
    """A tangent that is being assembled."""

    def __init__(self, matrix: Any, prolongation: Any) -> None:
        """Begin with none; the matrix has `add_nodal` and `add_coupling`, see `CondensedMatrix`."""
        self.matrix, self.prolongation = matrix, prolongation
        P = prolongation.increments.P
        self._moves: Array = P.reshape(len(P), P.shape[1] // 3, 3, P.shape[2])
        # Derivative of Σ a fᵀ of this rank's forces by the unknowns of their body, shape (bodies,
        # 3 n, unknowns).
        self.moments: Array = np.zeros_like(P)

    @property
    def blocks(self) -> Array:
        """Derivative of the forces on the bodies' unknowns, shape (bodies, 6, 6) [N/m]."""
        return np.asarray(self.prolongation.increments.L.swapaxes(1, 2) @ self.moments)

    def add(self, at: Any, blocks: Array, which: Ints | None = None) -> None:
        """Add blocks of stiffness [N/m] of each of some `Nodes`, or of sorted ones. Collective."""
        size = at.rows.size
        count = size if which is None else int(np.searchsorted(which, size))
        free = at.free if which is None else at.free[which[:count]]
        self.matrix.add_nodal(free, blocks[:count])
        if count < len(blocks):
            A = at.coordinates(None if which is None else which[count:] - size)
            moved = (A @ self._moves.reshape(A.shape[1], -1)).reshape(A.shape[0], 3, -1)
            forces = (blocks[count:] @ moved).reshape(A.shape[0], -1)
            self.moments += (A.T @ forces).reshape(self.moments.shape)

    def add_spread(self, spread: Array, K: Array) -> None:
        """Add K, shape (3, 3) [N/m], on nodes of bodies, Σ w a aᵀ being (bodies, n, n)."""
        if len(spread):
            rows = (K @ self._moves).reshape(*spread.shape[:2], -1)
            self.moments += (spread @ rows).reshape(self.moments.shape)


class Nodes:
    """Some nodes of this rank; arrays have those in no body first, and then each body's."""

    def __init__(self, structure: Structure, nodes: npt.NDArray[Any]) -> None:
        """Find whose owned nodes of this rank are; those that take no part are left out."""
        rows, u = structure.rows, structure.u.reshape(-1, 3)  # up to date at all nodes of bodies
        self._comm: MPI.Intracomm = structure.scene.comm
        self.share = 1.0 if structure.static else 0.5  # part of a step at whose end forces are
        place = np.full(len(u), -1)
        place[rows.nodes[structure.own]] = np.flatnonzero(structure.own)
        mine = np.flatnonzero(place[nodes] >= 0)
        self.free = np.asarray(nodes[mine], dtype=np.int32)  # those in no body
        self.rows = place[self.free]  # their places among the nodes of the rows
        self._X, self._dofs = rows.X[self.rows], rows.dofs.reshape(-1, 3)[self.rows]
        self._u0, self._pose = structure.u, structure.bodies.pose
        body, coordinates, _ = structure.bodies.of.holding(len(u))
        held = np.flatnonzero(body[nodes] >= 0)
        held = held[np.argsort(body[nodes[held]], kind="stable")]
        self.order: Ints = np.concatenate([mine, held])  # places among the nodes that were named
        self.nodes = np.asarray(nodes[self.order])  # numbers of all on this rank
        of = np.asarray(body[nodes[held]], dtype=np.int64)
        self.bodies: Ints = np.r_[np.full(mine.size, -1), of]  # that each is in, -1 if none
        self._hold(of, coordinates[nodes[held]], u[nodes[held]])

    def _hold(self, of: Ints, coordinates: Array, displacement: Array) -> None:
        """Store body, a and displacement of nodes in bodies."""
        self._of, self._a, self._held = of, coordinates, displacement
        n = self._pose.shape[1]
        columns = (n * of[:, None] + np.arange(n)).ravel()
        size = len(of), n * len(self._pose)
        A = csr_array((coordinates.ravel(), columns, n * np.arange(len(of) + 1)), shape=size)
        self._A: Matrix = compact(A)
        self._At: Matrix = self._A.T if isinstance(self._A, np.ndarray) else A.T.tocsr()

    def __len__(self) -> int:
        return self.rows.size + len(self._of)

    def coordinates(self, held: Ints | None = None) -> Matrix:
        """Body-fixed coordinates of nodes in bodies, or of some, (nodes, n · bodies)."""
        return self._A if held is None else self._A[held]

    def follow(self, matrices: Array) -> Array:
        """Numbers of nodes in bodies by matrices of these, shape (bodies, n, k)."""
        return np.asarray(self._A @ matrices.reshape(self._A.shape[1], -1))

    def gather(self, values: Array) -> Array:
        """Σ a v over each body of numbers of nodes in bodies, shape (bodies, n, k)."""
        return np.asarray(self._At @ values).reshape(*self._pose.shape[:2], -1)

    def _all(self, of_rows: Array, matrices: Array) -> Array:
        """Vectors of all nodes: those of rows, and of bodies by matrices of these."""
        return np.concatenate([of_rows, self.follow(matrices)]) if len(self._of) else of_rows

    # Where they are -----------------------------------------------------------------------------

    def positions(self, at: Instant) -> Array:
        """Positions, shape (nodes, 3) [m]."""
        return self._all(self._X + self._displaced(at.u), at.bodies.pose)

    def displacement(self, at: Instant) -> Array:
        """Displacements, likewise [m]."""
        if not len(self._of):
            return self._displaced(at.u)
        held = self._held + self.follow(at.bodies.pose - self._pose)
        return np.concatenate([self._displaced(at.u), held])

    def _displaced(self, u: Array | None) -> Array:
        return self._u0[self._dofs] if u is None else u.reshape(-1, 3)[self.rows]

    def moved(self, motion: Motion) -> Array:
        """Increments of displacements at an iterate, likewise [m]."""
        return self._all(motion.nodes[self.rows], motion.increments.displacement)

    def velocities(self, v: Array, bodies: Bodies) -> Array:
        """Velocities, likewise, by those of the rows, one number each, and of the bodies [m/s]."""
        return self._all(v.reshape(-1, 3)[self.rows], bodies.pose_rate)

    # Forces on them -----------------------------------------------------------------------------

    def far(self) -> float:
        """Largest coordinate of one of them at the start of a step [m]. Collective."""
        x = self._X + self._u0[self._dofs], self.follow(self._pose) if len(self._of) else self._held
        own = max(float(np.abs(part).max(initial=0.0)) for part in x)
        return self._comm.allreduce(own, op=MPI.MAX)

    def add(self, force: Array, forces: Forces | ForcesOfNodes) -> None:
        """Add forces on them, shape (nodes, 3) [N]."""
        forces.add(self, force)

    def acted(self, ways: Array) -> tuple[Ints, Array]:
        """Numbers of those that are not zero in an array, and their part of it."""
        some = ways.any(axis=(1, 2))
        return self.nodes[some].astype(np.int64), ways[some]

    def stiffen(self, blocks: Array, tangent: Tangent, which: Ints | None = None) -> None:
        """Add the stiffness of each, or of some, by itself: see `Tangent.add`. Collective."""
        tangent.add(self, blocks, which)


class LinearNodes(Nodes):
    """Nodes with weights, 1 of a representative, for forces that are linear in displacements.

    Those of a body's nodes need the sums Σ w c cᵀ of c = [a, u₀] only, u₀ at a reference pose. With
    QR of √w c these are Σ r rᵀ over the rows r = [s, e] of R: n + 3 representatives at most, of
    coordinates s, displacements e and weight 1. Forces, stiffness and energies are those of all.
    """

    def __init__(
        self, structure: Structure, nodes: npt.NDArray[Any], weights: Array, rest: Array
    ) -> None:
        """Find representatives of the nodes in bodies. Collective.

        Each owned node has a weight > 0; displacements count from `rest`, shape (nodes, 3) [m].
        """
        super().__init__(structure, nodes)
        count, weights, rest = self.rows.size, weights[self.order], rest[self.order]
        self._rest = rest[:count]
        rows = np.sqrt(weights[count:, None]) * np.c_[self._a, self._held - rest[count:]]
        size = rows.shape[1]
        R = np.concatenate([_factor(rows[self._of == k]) for k in range(len(self._pose))] or [rows])
        every = self._comm.allgather(R.reshape(len(self._pose), size, size))
        R = np.stack(
            [_factor(own) for own in np.concatenate(every, axis=1)] or [np.empty((0, size))]
        )
        self._begun: Instant | None = None  # displacements are known there
        self._start = rest
        # All ranks know them; the first one has them, as it might have nodes.
        of, which = np.nonzero(R.any(axis=-1) & bool(structure.once))
        self.weights = np.r_[weights[:count], np.ones(len(of))]
        self.nodes = np.r_[self.free, np.full(len(of), -1)]
        self._hold(of, R[of, which, :-3], R[of, which, -3:])

    def _displaced(self, u: Array | None) -> Array:
        return super()._displaced(u) - self._rest

    def start(self, motion: Motion) -> Array:
        """Displacements at the start of a step, found once in it, shape (nodes, 3) [m]."""
        if motion.begun is None or self._begun is not motion.begun:
            self._begun, self._start = motion.begun, self.displacement(motion.start)
        return self._start


class SharedNodes(Nodes):
    """Nodes whose forces depend on each other; arrays over all of them are equal on all ranks."""

    def __init__(
        self, structure: Structure, nodes: npt.NDArray[Any], numbers: Ints, size: int
    ) -> None:
        """Find whose nodes are; their numbers go from 0 to `size` on all ranks. Collective."""
        super().__init__(structure, nodes)
        self.size, self._numbers = size, np.asarray(numbers)[self.order]
        of = self._everywhere(np.asarray(self.bodies[:, None] + 1, dtype=np.float64))[:, 0]
        self.bodies = of.astype(np.int64) - 1  # of all
        a = np.zeros((len(self._numbers), self._pose.shape[1]))
        a[self.rows.size :] = self._a
        self._coordinates = self._everywhere(a)
        deforms = np.array([b.deforms_by > 0 for b in structure.bodies.of.records] + [False])
        self.rigid = np.where(deforms[self.bodies], -1, self.bodies)  # -1 in one that deforms, too
        # Whether all are in the same rigid body, and so cannot move against each other.
        self.in_one_body = bool((self.rigid >= 0).all() and np.ptp(self.rigid) == 0)
        self._unknowns: Ints | None = None

    def _everywhere(self, values: Array) -> Array:
        """Values of all nodes from those of this rank, zero where there are none. Collective."""
        return on_all_ranks(self._comm, self.size, self._numbers, values)

    def _all(self, of_rows: Array, matrices: Array) -> Array:
        return self._everywhere(super()._all(of_rows, matrices))

    def add(self, force: Array, forces: Forces | ForcesOfNodes) -> None:
        """Add forces on them, which are equal on all ranks, shape (size, 3) [N]."""
        forces.add(self, force[self._numbers])

    def acted(self, ways: Array) -> tuple[Ints, Array]:
        """Those of this rank, by an array of all."""
        return super().acted(ways[self._numbers])

    def couple(self, nodes: Ints, G: Array, stiffness: Array, tangent: Tangent) -> None:
        """Add the stiffness of scalars of several nodes: Σ s (Lᵀ G)(Gᵀ P). Collective.

        Each depends on k nodes by derivatives G, shape (scalars, k, 3), with a stiffness s [N/m].
        """
        p = tangent.prolongation
        if self._unknowns is None:
            self._unknowns = self._numbered(p)
        left, right = (self._by(M, nodes, G, p) for M in (p.increments.L, p.increments.P))
        tangent.matrix.add_coupling((left.T @ diags_array(stiffness) @ right).tocsr())

    def _numbered(self, prolongation: Any) -> Ints:
        """Unknown of each dof of all nodes, -1 where there is none, shape (size, 3). Collective."""
        own = np.zeros((len(self._numbers), 3))
        own[: self.rows.size] = prolongation.numbers.reshape(-1, 3)[self.rows] + 1.0
        return self._everywhere(own).astype(np.int64) - 1

    def _by(self, M: Array, nodes: Ints, G: Array, prolongation: Any) -> csr_array:
        """Derivatives of scalars, M being L or P of the bodies, shape (bodies, 3 n, unknowns)."""
        assert self._unknowns is not None
        scalar = np.broadcast_to(np.arange(len(nodes))[:, None], nodes.shape)
        alone = self.bodies[nodes] < 0
        columns = [self._unknowns[nodes[alone]].reshape(-1)]
        values = [G[alone].reshape(-1)]
        rows = [np.repeat(scalar[alone], 3)]
        if not alone.all():
            held = nodes[~alone]
            of, a = self.bodies[held], self._coordinates[held]
            moves = M.reshape(len(M), a.shape[1], 3, -1)[of]
            moved = np.einsum("na,naij,ni->nj", a, moves, G[~alone])
            columns.append(prolongation.body_columns[of].reshape(-1))
            values.append(moved.reshape(-1))
            rows.append(np.repeat(scalar[~alone], moved.shape[1]))
        row, column, value = (np.concatenate(part) for part in (rows, columns, values))
        known = column >= 0
        shape = len(nodes), prolongation.size
        return csr_array((value[known], (row[known], column[known])), shape=shape)


def on_all_ranks(comm: MPI.Intracomm, size: int, numbers: Ints, values: Array) -> Array:
    """Values that ranks have of things with these numbers, shape (size, ...). Collective."""
    out = np.zeros((size, *values.shape[1:]))
    out[numbers] = values
    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, out)
    return out


def _factor(rows: Array) -> Array:
    """R of a QR factorisation, with rows of zeros up to its number of columns."""
    R = np.asarray(np.linalg.qr(rows, mode="r"))
    out = np.zeros((rows.shape[1], rows.shape[1]))
    out[: len(R)] = R
    return out

"""Joints of a structure that vibrates: the motions that they leave free, and their springs.

Joints hold G y = 0. Of as many independent rows as there are, each gives one unknown by the others:

    y = Z q,    G Z = 0,    (ZᵀKZ) φ = λ (ZᵀMZ) φ,

so that there are as many modes as unknowns less rows, and no stiffness stands for a joint. The
given unknowns are the pivots of a QR of G, which keeps the entries of Z small. Locks are rows,
springs of joints and of remote points a stiffness.

Forces in the state are a stiffness, too. K is the derivative of all that act, on nodes, on the
places of joints and on bodies, where they turn along: with the energy V, the rows g and their
forces λ, for which dV + λ dg = 0, it is that of d²V + λ d²g (J. Nocedal and S. Wright, Numerical
Optimization, 2nd ed., Section 12.5).
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import qr, solve_triangular
from scipy.sparse import csr_array, dia_array

from rigidfx.base.matrices import distributed
from rigidfx.base.types import Array, Ints
from rigidfx.coupling.ports import RANK, independent
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.equations.constraints import Constraints


class HeldRows:
    """The rows that hold a state which vibrates, and the stiffness of their forces.

    Attributes:
        held: Derivatives of independent rows by the unknowns of all ranks, shape (rows, unknowns).
    """

    def __init__(self, constraints: Constraints, bodies: Bodies, p: Prolongation) -> None:
        """Find the rows of the state's equations, with the bodies as they are there. Collective."""
        self._constraints, self._p = constraints, p
        linkage, ports = constraints.linkage, constraints.ports
        active = linkage.rows.active.size
        self._locked = np.r_[np.ones(active, dtype=bool), linkage.drives.prescribed]
        rows, terms, compliance = ports.resisted(linkage, bodies)
        locks, of_locks = ports.led(linkage.test()[np.flatnonzero(self._locked)[active:]])
        rows = np.vstack([rows, locks])
        kept = independent(rows, np.vstack([terms, of_locks]), compliance)
        every = ports.everywhere()
        self.held = csr_array(csr_array(rows[kept]) @ every)
        self._averages = csr_array(csr_array(ports.lead(p.increments)) @ every)  # by unknowns

    def balance(self, y: PETSc.Vec, r: PETSc.Vec, masses: Array) -> None:
        """Set multipliers among unknowns y to forces of joints that balance r [N] best. Collective.

        At an equilibrium these are its own; elsewhere those that joints begin to have. Unknowns of
        this rank have masses [kg].
        """
        rows, p, locked = self._constraints, self._p, self._locked
        own = csr_array(csr_array(rows.linkage.test()) @ self._averages)
        own = own[:, p.first_column : p.first_column + p.owned].toarray()
        forces = np.zeros(locked.size)
        gaps, compliance = rows.of_rows(r.array_r) / rows.scale, rows.linkage.compliance()
        forces[~locked] = -gaps[~locked] / compliance[~locked]
        rest = r.array_r[: p.owned] + own.T @ forces
        G = own[locked]
        largest = p.comm.allreduce(masses.max(initial=0.0), MPI.MAX)
        weighted = G / np.maximum(masses, np.sqrt(np.finfo(np.float64).eps) * largest)
        A, b = p.comm.allreduce(weighted @ G.T), p.comm.allreduce(weighted @ rest)
        forces[locked] = p.comm.bcast(-np.linalg.lstsq(A, b, rcond=RANK)[0])
        y.array[p.owned :] = (forces / rows.scale)[: rows.own]

    def stiffness_matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """Stiffness of joints, springs and remote points at the last iterate, with the rows of K.

        The caller destroys it. Collective.
        """
        linkage, E = self._constraints.linkage, self._averages
        along = csr_array(linkage.test()[linkage.rows.active.size :])
        springs = dia_array((linkage.drives.stiffness()[None], [0]), shape=2 * along.shape[:1])
        bent = linkage.curvature()  # of torques, which have no energy, the symmetric part
        C = csr_array(0.5 * (bent + bent.T) + along.T @ springs @ along)
        own = csr_array(csr_array(E.T @ C @ E)[slice(*K.getOwnershipRange())])
        return distributed(own, K.getSizes(), K.comm)


def free_motions(held: csr_array, prolongation: Prolongation) -> tuple[PETSc.Mat, Ints]:
    """Z, which the caller destroys, and the unknowns of this rank that are in q. Collective.

    Independent rows that are held, shape (rows, unknowns), are equal on all ranks.
    """
    comm, size, count = prolongation.comm, prolongation.size, held.shape[0]
    used = np.unique(held.tocoo().coords[1])
    rows = held[:, used].toarray()
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    R, order = qr(rows, mode="r", pivoting=True)
    by = -solve_triangular(R[:count, :count], R[:count, count:])
    given, others, by = comm.bcast((used[order[:count]], used[order[count:]], by))
    free = np.setdiff1d(np.arange(size), given)
    row = np.r_[free, np.repeat(given, others.size)]
    column = np.r_[np.arange(free.size), np.tile(np.searchsorted(free, others), count)]
    values = np.r_[np.ones(free.size), by.ravel()]
    Z = csr_array((values, (row, column)), shape=(size, free.size))
    first, owned = prolongation.first_column, prolongation.owned
    kept = free[(free >= first) & (free < first + owned)] - first
    sizes = (owned, size), (kept.size, free.size)
    return distributed(csr_array(Z[first : first + owned]), sizes, comm), kept

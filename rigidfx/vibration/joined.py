"""The stiffness of a structure with joints: stiff springs along the rows that joints hold.

A spring of stiffness β along each row G y makes the eigenvalues λ of (K + β GᵀG) φ = λ M φ too low
by β |G φ|² but for what is of second order in 1/β, so that this is added: joints are as stiff as
they are exact. In a matrix such springs drown eight digits of the rest, so that λ is taken as
φᵀKφ + 2 β |G φ|², without them in K. Springs of joints act as they are, locks as rows.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, dia_array, vstack

from rigidfx.coupling.ports import Ports
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.joints.drives import prescribes
from rigidfx.effects.joints.linkage import Linkage
from rigidfx.effects.joints.redundancy import independent
from rigidfx.mechanics.bodies import Bodies

__all__ = ["JoinedStiffness"]

Array = npt.NDArray[np.float64]


class JoinedStiffness:
    """Springs along the rows of joints, and those of remote points."""

    def __init__(self, linkage: Linkage, bodies: Bodies, prolongation: Prolongation) -> None:
        """Find the rows. Collective.

        Args:
            linkage: The joints.
            bodies: The bodies at the state.
            prolongation: Map between unknowns and dofs, in the pose of the bodies.
        """
        self._comm = prolongation.comm
        ports = Ports(prolongation, linkage)
        linkage.begin(bodies)
        rows, terms, compliance = ports.resisted(linkage, bodies)
        held = csr_array(rows[independent(rows, terms, compliance)])
        drives, columns = linkage.drives, 3 * linkage.averages
        start = linkage.places(bodies)
        drives.look(start, np.zeros_like(start), drives.multipliers)
        along = csr_array(drives.test(columns) @ ports.lead(prolongation.increments.L))
        laws = np.array([prescribes(effect) for effect in drives.effects], dtype=bool)
        held = csr_array(vstack([held, along[np.flatnonzero(laws)]]))
        # Over the stiffness of what joints move: neither its inverse's square nor rounding counts.
        self._beta = float(np.sqrt(np.sqrt(1 / np.finfo(np.float64).eps))) * linkage.typical[0]
        self._own = csr_array(held @ ports.entries.T)
        E = ports.everywhere()
        G, T = csr_array(held @ E), csr_array(along @ E)
        springs = csr_array(self._beta * (G.T @ G))
        self._soft = csr_array(springs.shape)  # of springs of joints and remote points
        if len(drives):
            k = dia_array((drives.stiffness()[None], [0]), shape=(len(drives),) * 2)
            self._soft = csr_array(self._soft + T.T @ k @ T)
        if len(linkage.points):
            linkage.points.look(start, np.zeros_like(start))
            P = csr_array(ports.lead(prolongation.increments.L) @ E)
            K = linkage.points.stiffness()  # of torques, which have no energy, the symmetric part
            self._soft = csr_array(self._soft + 0.5 * (P.T @ (K + K.T) @ P))
        self._stiffness = csr_array(springs + self._soft)

    def added_to(self, K: PETSc.Mat) -> PETSc.Mat:
        """A stiffness with the springs, as a new matrix; the caller destroys it. Collective."""
        out = K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        own = self._stiffness[slice(*K.getOwnershipRange())]
        kind = PETSc.IntType
        csr = own.indptr.astype(kind), own.indices.astype(kind), own.data
        more = PETSc.Mat().createAIJ(K.getSizes(), csr=csr, comm=K.comm)
        out.axpy(1.0, more, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        more.destroy()
        return out

    def square(self, K: PETSc.Mat, y: PETSc.Vec) -> float:
        """λ of a vector with φᵀMφ = 1, and joints that do not yield [1/s²]. Collective.

        Args:
            K: The stiffness without joints.
            y: φ.
        """
        image = K.createVecLeft()
        K.mult(y, image)
        moved = np.asarray(self._own @ y.array_r)
        self._comm.Allreduce(MPI.IN_PLACE, moved)
        every = np.concatenate(self._comm.allgather(y.array_r))
        soft = float(every @ (self._soft @ every))
        out = float(y.dot(image)) + soft + 2 * self._beta * float(moved @ moved)
        image.destroy()
        return out

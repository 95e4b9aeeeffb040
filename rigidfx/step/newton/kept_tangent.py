"""Solve linear systems by a tangent of an earlier iterate, turned along with the structure.

Assembling and factoring a tangent costs ten times a residual and a solve with the factors. A
structure that vibrates has nearly the same tangent in all steps, and one that turns has nearly the
same in its own frame. So corrections are

    z = Q A₀⁻¹ Qᵀ r,    Q = R R₀ᵀ,

with the rotations R of nodes and bodies at the start of the step (`frames`), and R₀ those of the
step in which A₀ was assembled. Newton's method then converges linearly, the faster the better the
tangent fits. For a steadily turning body the fit is exact.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.types import Array
from rigidfx.step.newton.border import Border
from rigidfx.step.newton.factors import Factors
from rigidfx.step.newton.frames import Frames
from rigidfx.step.newton.incomplete import IncompleteFactors
from rigidfx.step.newton.low_rank import LowRank

NEAR = 0.1  # change of Δt that a tangent survives
Inverse = Factors | IncompleteFactors  # solvers with a tangent that has been assembled once
MOST = 12  # pairs that are kept
INDEPENDENT = 1e-4  # square of the part in which pairs have to differ


class Secants:
    """Mends the corrections of a kept tangent.

    From one iterate to the next a correction s moves the unknowns, and the residual changes by J s.
    So the correction that the kept tangent gives, z = A₀⁻¹ r, changes by A₀⁻¹ J s: the known pairs
    correct z (D. G. Anderson, J. ACM 12 (1965) 547-560, of type II),

        J⁻¹ r ≈ z + Σ c (s − Δz) ,    c by the least squares of z − Σ c Δz .

    Parts that bend stay near the shape of a step before. So pairs are kept over steps, in the frame
    of the tangent, until there is a new one.

    Attributes:
        known: How many pairs are kept.
    """

    def __init__(self, comm: MPI.Intracomm, size: int) -> None:
        """Begin without pairs.

        Args:
            comm: Communicator of the unknowns.
            size: How many of them this rank owns.
        """
        self._comm = comm
        self._changes = np.zeros((MOST, size))  # Δz, the newest in a place of its own by turns
        self._mending = np.zeros((MOST, size))  # s - Δz
        self._products = np.zeros((MOST, MOST))
        self.forget()

    def forget(self) -> None:
        """Drop all pairs: there is a new tangent."""
        self.known, self._next = 0, 0
        self.begin()

    def begin(self) -> None:
        """Begin the iterates of a step, or of an attempt at it."""
        self._last: tuple[Array, Array] | None = None

    def mend(self, z: Array, learning: bool) -> None:
        """Improve a correction by the known pairs, and learn from it. Collective.

        Args:
            z: The kept tangent's correction, shape (unknowns,); changed in place.
            learning: Whether a pair is learned from it. Pairs of mere rounding made steps of a
                plate that hardly strains fail.
        """
        given = z.copy()
        if learning and self._last is not None:
            self._learn(given)
        if self.known:
            z += self._coefficients(given) @ self._mending[: self.known]
        self._last = given, z.copy()

    def _learn(self, given: Array) -> None:
        """Add the pair of the last two iterates."""
        assert self._last is not None
        before, taken = self._last
        k = self._next
        np.subtract(given, before, out=self._changes[k])
        np.negative(taken, out=self._mending[k])
        self._mending[k] -= self._changes[k]
        self.known, self._next = max(self.known, k + 1), (k + 1) % MOST
        row = self._sums(self._changes[k])
        self._products[k, : self.known] = self._products[: self.known, k] = row

    def _sums(self, vector: Array) -> Array:
        """Products of a vector with all Δz, on all ranks."""
        with np.errstate(over="ignore", invalid="ignore"):  # infinite: see _coefficients
            out: Array = self._changes[: self.known] @ vector
        self._comm.Allreduce(MPI.IN_PLACE, out, op=MPI.SUM)
        return out

    def _coefficients(self, given: Array) -> Array:
        """c of each pair."""
        products = self._products[: self.known, : self.known]
        sizes = np.sqrt(products.diagonal())
        if not (np.isfinite(sizes).all() and sizes.all()):
            return np.zeros(self.known)  # what overflows is no step
        # As numpy's pinv, of whose time this takes a quarter: an eighth of small models' steps.
        squares, parts = np.linalg.eigh(products / np.outer(sizes, sizes))
        differ = squares > INDEPENDENT * squares[-1]
        parts = parts[:, differ]
        out: Array = parts @ ((self._sums(given) / sizes) @ parts / squares[differ]) / sizes
        return out


class KeptTangent:
    """A preconditioner of PETSc's in Python: all of a linear solve, by kept factors.

    Attributes:
        inverse: Solves with the tangent.
        iterations: How many it has taken since the step began.
        learning: Whether the next correction tells something of the tangent.
    """

    def __init__(
        self,
        inverse: Inverse,
        frames: Frames,
        contacts: LowRank,
        y: PETSc.Vec,
        border: Border,
    ) -> None:
        """Keep the solver of a matrix that others fill.

        Args:
            inverse: Solves with it.
            frames: Nodes and bodies of the structure.
            contacts: Corrects it where contacts change.
            y: Of the kind of the unknowns; not kept.
            border: Joints.
        """
        self.inverse, self._frames, self._border = inverse, frames, border
        self._contacts = contacts
        self._right = y.duplicate()
        self._secants = Secants(y.comm.tompi4py(), y.getLocalSize())
        self._now: Array = np.empty((0, 3, 3))
        self._then: Array | None = None  # nothing is known, also on a rank without vectors
        self._Q: Array | None = None
        self._factor = 1.0
        self._dt = self._assembled_for = 0.0
        self.iterations, self.learning = 0, True

    def replace(self, inverse: Inverse) -> None:
        """Replace the inverse by one that has no tangent yet. Collective.

        Args:
            inverse: Solves with a matrix that others fill.
        """
        self.inverse.destroy()
        self.inverse, self._assembled_for = inverse, 0.0
        self._contacts.renewed(None)

    def fits(self, dt: float) -> bool:
        """Whether a step of Δt [s] is near enough to the one that the tangent was assembled for."""
        return abs(dt - self._assembled_for) <= NEAR * dt

    def begin(self, u: Array, dt: float) -> None:
        """Begin a step: find how the structure stands. Collective.

        Args:
            u: Displacement of all local nodes at its start, ghosts included [m].
            dt: Δt [s].
        """
        self.iterations = 0
        self._now = self._frames.rotations(u)
        self._Q = None if self._then is None else self._now @ self._then.swapaxes(1, 2)
        self._border.turn(self._frames.starts, self._Q)
        if dt != self._dt:
            self._secants.forget()
        self._secants.begin()
        # The inertial part of a tangent goes with 1/Δt², the elastic one stays: this is right in
        # the middle.
        self._dt, self._factor = dt, 2 / (1 + (self._assembled_for / dt) ** 2)
        self._contacts.turn(self._Q, self._factor)

    def _solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve in the frame of the tangent, without joints. Collective."""
        self.inverse.solve(r, z)
        self._contacts.mend(z)

    def follow(self, entries: csr_array) -> bool:
        """Update the tangent by the stiffness of contacts at the last iterate. Collective.

        Args:
            entries: The stiffness, equal on all ranks.

        Returns:
            False if a new tangent is as cheap, and nothing is changed.
        """
        most, solve = self.inverse.renewal, self.inverse.solve
        if not self._contacts.follow(entries, self._Q, self._factor, most, solve):
            return False
        self._secants.forget()
        self._border.renew(self._solve)
        return True

    def renewed(self, entries: csr_array | None) -> None:
        """Record that the tangent has just been assembled, in this step. Collective.

        Args:
            entries: Stiffness of contacts in it; None without any.
        """
        self.inverse.renew()
        self._contacts.renewed(entries)
        self._border.renew(self.inverse.solve)
        self._secants.forget()
        self._then, self._Q = self._now, None
        self._assembled_for, self._factor = self._dt, 1.0

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call: z = Q A₀⁻¹ Qᵀ r. Collective."""
        r.copy(self._right)
        if self._Q is not None:
            self._frames.turn(self._right.array, self._Q, back=True)
        self._border.solve(self._solve, self._right, z)
        if self._factor != 1.0:
            z.scale(self._factor)
        self._secants.mend(z.array, self.learning)
        if self._Q is not None:
            self._frames.turn(z.array, self._Q)
        self.iterations += self.inverse.iterations

    def destroy(self, pc: PETSc.PC) -> None:
        """PETSc's call: free the inverse and the work vector. Collective."""
        self.inverse.destroy()
        self._contacts.destroy()
        self._right.destroy()
        self._border.destroy()

"""Knowledge of the true tangent in the iterates of a kept one: secants, after D. G. Anderson.

From one iterate to the next a correction s moves the unknowns, and the residual changes by J s. So
the correction that the kept tangent gives, z = A₀⁻¹ r, changes by A₀⁻¹ J s: the known pairs correct
z (D. G. Anderson, J. ACM 12 (1965) 547-560, of type II),

    J⁻¹ r ≈ z + Σ c (s − Δz) ,    c by the least squares of z − Σ c Δz .

Parts that bend stay near the shape of a step before. So pairs are kept over steps, in the frame of
the tangent, until there is a new one.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx.base.types import Array

__all__ = ["Secants"]


MOST = 12  # pairs that are kept
INDEPENDENT = 1e-4  # square of the part in which pairs have to differ


class Secants:
    """Mends the corrections of a kept tangent.

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
        """Take the pair of the last two iterates."""
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

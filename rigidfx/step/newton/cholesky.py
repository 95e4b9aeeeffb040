"""Solve with the symmetric part of a tangent, by Cholesky's factors.

The forces of a step act at its middle, its strains are measured at its end. So the skew part of a
tangent grows with the rotation and strain in half a step, and is small in vibrations. Newton's
iteration with a kept tangent removes the error by the missing skew part. Cholesky's factors have
half of the entries of LU, which halves the time of a solve and of a new tangent. They do not exist
if the matrix is not definite, as near buckling.
"""

from __future__ import annotations

from petsc4py import PETSc

from rigidfx.step.linear import cholmod
from rigidfx.step.linear.linear_solver import PREFIX
from rigidfx.step.newton.price import entries_of

__all__ = ["Cholesky"]

OWN = PREFIX + "cholesky_"  # prefix of its options
# Skew part, relative to all of a tangent, in Frobenius' norm. A residual falls to 2 to 14 times
# that in an iteration.
SKEW = 2e-3
UNKNOWN = PETSc.Mat.Structure.UNKNOWN_NONZERO_PATTERN  # PETSc compares them: the same, as a rule


class Cholesky:
    """Factors of the symmetric part of one matrix; `destroy` frees them.

    Options of PETSc's are understood under the prefix `rigidfx_cholesky_`, or another.

    Attributes:
        ksp: Solves with them once there are any.
    """

    def __init__(self, A: PETSc.Mat, prefix: str = OWN, skew: float = SKEW) -> None:
        """Set the solver up. Collective.

        Args:
            A: The matrix, of one rank.
            prefix: Prefix of the solver's options.
            skew: Largest skew part, relative to the matrix.
        """
        self._A, self._skew = A, skew
        self._transposed, self._symmetric = PETSc.Mat(), PETSc.Mat()
        self._entries = 0.0
        self.ksp = cholmod.solver(A.comm, prefix)

    def renew(self) -> bool:
        """Factor the matrix as it is now; false if it is too far from symmetric, or not definite.

        If false, it cannot be used any more.
        """
        return self._symmetrize() and cholmod.factor(self.ksp, self._symmetric)

    def _symmetrize(self) -> bool:
        """Find the symmetric part; false if it is not near enough to all of the matrix."""
        entries = entries_of(self._A)
        if entries != self._entries:  # the pattern is new, or has grown
            self._entries = entries
            self._forget()
        self._A.transpose(self._transposed)
        self._transposed.axpy(1.0, self._A, UNKNOWN)
        self._transposed.scale(0.5)
        whole, symmetric = self._A.norm(), self._transposed.norm()
        if not whole - symmetric <= 0.5 * self._skew**2 * whole:  # as ‖A‖² = ‖sym A‖² + ‖skw A‖²
            return False
        self._transposed.convert(PETSc.Mat.Type.AIJ, self._symmetric)
        return True

    def _forget(self) -> None:
        """Free the matrices."""
        for item in (self._transposed, self._symmetric):
            item.destroy()

    def destroy(self) -> None:
        """Free factors and matrices."""
        self.ksp.destroy()
        self._forget()

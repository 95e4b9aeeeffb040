"""What solvers with a kept tangent have in common that take iterations of PETSc's KSP."""

from __future__ import annotations

from petsc4py import PETSc

__all__ = ["Krylov"]


class Krylov:
    """A solver whose `_ksp` is told in reports."""

    _ksp: PETSc.KSP

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._ksp.getType()}+{self._ksp.getPC().getType()}"

    @property
    def iterations(self) -> int:
        """How many the last solve took."""
        return int(self._ksp.getIterationNumber())

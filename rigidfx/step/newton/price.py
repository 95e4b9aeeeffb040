"""Cost of a new tangent, in iterations with the factors of a kept one.

All is in units of the time of an iteration for each entry of the tangent beside its solve, 1.8 ns.
Counts tell it and no clock does, so that runs are the same each time. Of 20 systems of 160 to 19
000 unknowns, bars, plates and blocks, soft and of steel, second order and enhanced, a frame and the
block with a cantilever, the sum by LU was .8 to 1.6 times the measured cost, 2 to 47.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

__all__ = ["Held", "entries_of", "held_by_cholmod", "held_by_mumps", "held_by_petsc", "price"]

ASSEMBLED, CALLS = 13.0, 65e3  # to assemble an entry of a tangent, and all calls of an iteration


@dataclass(frozen=True)
class Held:
    """Cost of factors.

    Attributes:
        making: To make them.
        solving: To solve with them.
    """

    making: float
    solving: float


def held_by_mumps(factors: PETSc.Mat) -> Held:
    """Of LU by MUMPS: so much for each entry, and for each floating-point operation."""
    entries = float(factors.getMumpsInfog(29))
    entries = entries if entries >= 0 else -1e6 * entries  # in millions where they are many
    return Held(8.0 * entries + 0.007 * factors.getMumpsRinfog(3), 0.55 * entries)


def held_by_petsc(factors: PETSc.Mat) -> Held:
    """Of LU by PETSc itself, on one rank; its operations are those of a band."""
    entries = entries_of(factors)
    return Held(0.13 * entries**2 / (2 * factors.size[0]), 0.13 * entries)


def held_by_cholmod(factors: PETSc.Mat) -> Held:
    """Of Cholesky's factors, the symmetric part included.

    Measured were 12 to 14 and .63 to .8 of parts of steel of 10⁴ to 2·10⁴ unknowns, and 9 to make
    those of bars of 1347 and 4347.
    """
    entries = entries_of(factors)
    return Held(13.0 * entries, 0.75 * entries)


def price(A: PETSc.Mat, held: Held) -> float:
    """Cost of a new tangent in iterations with a kept one. Collective.

    Args:
        A: The tangent.
        held: Cost of its factors.
    """
    entries = entries_of(A)
    iteration = entries + CALLS + held.solving
    return (ASSEMBLED * entries + held.making) / iteration


def entries_of(A: PETSc.Mat) -> float:
    """Entries of a matrix on all ranks. Collective."""
    return float(A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"])

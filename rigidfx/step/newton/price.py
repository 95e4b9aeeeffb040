"""Cost of a new tangent, in iterations with the factors of a kept one.

The unit is the time of an iteration, without its solve, for each entry of the tangent: 1.8 ns.
Costs come from counts, not from a clock, so runs repeat exactly. In parts of steel of
10⁴ to 2·10⁴ unknowns an entry of Cholesky's factors took 12 to 14 in factoring and .63 to .8 in a
solve, an entry of a tangent 13 in assembly.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

__all__ = ["Prices", "entries_of", "price"]


@dataclass(frozen=True)
class Prices:
    """Costs of entries.

    Attributes:
        making: To assemble an entry of a tangent, or to make one of its factors.
        solving: To solve with an entry of factors.
        calls: All calls of an iteration.
    """

    making: float = 13.0
    solving: float = 0.75
    calls: float = 65e3


def price(A: PETSc.Mat, factors: PETSc.Mat, prices: Prices = Prices()) -> float:
    """Cost of a new tangent in iterations with a kept one. Collective.

    Args:
        A: The tangent.
        factors: Its factors, by MUMPS, CHOLMOD or PETSc itself.
        prices: Costs of entries.
    """
    own, filled = entries_of(A), entries_of(factors)
    return prices.making * (own + filled) / (own + prices.calls + prices.solving * filled)


def entries_of(A: PETSc.Mat) -> float:
    """Entries of a matrix on all ranks. Collective."""
    return float(A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"])

"""What is left to a structure to move with, once its quiet cells are rigid.

Where a structure comes to rest all its cells become quiet, and those that stay flexible, at
supports for instance, have to take the motion of all. As long as a motion goes on as it is,
flexible cells strain with the power D = ∫ Ė:C:Ė dV, C their stiffness; of cells that the same
forces strain, one after the other, each has a share by its compliance. If D_left of it is left,
forces change D/D_left times as fast, and so does what is withheld: as if quiet cells strained at
that many times their rate. A part that would so come near what wakes it is not quiet. The quietest
parts come first, as long as for each of them

    max e/tol · D/D_left ≤ κ/2,

half of what wakes cells. That is so where the motion is the structure's own, or swings so fast that
a window has room for half a period. Where loads change slowly, it is they that say how fast forces
change; and where all becomes rigid, nothing is left that could change them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.scene.scene import Scene

__all__ = ["Concentration", "quiet_enough", "stiffness"]

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int32]

HUGE = 1e300  # times a tolerance


class Concentration:
    """Knows how stiff the cells of a scene are."""

    def __init__(self, scene: Scene) -> None:
        """Take the stiffest parameter of each cell's material [Pa]."""
        self._comm, self._stiffness = scene.comm, stiffness(scene)

    def too_loud(
        self,
        parts: Sequence[Ints],
        rates: Array,
        weights: Array,
        tol: Array,
        flexible: Bools,
        most: float,
    ) -> Bools:
        """Owned cells of the parts that must not freeze. Collective.

        Args:
            parts: Owned flexible cells that are to freeze, of each body that is to be.
            rates: Largest strain rate of each owned cell in a window [1/s].
            weights: ∫ Ė:Ė dV of each over its rate squared [m³].
            tol: Its tolerance [1/s].
            flexible: Cells that are flexible now.
            most: What quiet cells may come to strain at, over their tolerances.
        """
        out = np.zeros(rates.size, dtype=bool)
        if not parts:
            return out
        power = np.where(flexible, self._stiffness * weights * rates**2, 0.0)
        left = flexible.copy()
        for own in parts:
            left[own] = False
        if not self._comm.allreduce(bool(left.any()), op=MPI.LOR):
            return out
        loud = np.array([_over(rates[own], tol[own]) for own in parts])
        share = np.array([power.sum(), *(power[own].sum() for own in parts)])
        self._comm.Allreduce(MPI.IN_PLACE, loud, op=MPI.MAX)
        self._comm.Allreduce(MPI.IN_PLACE, share, op=MPI.SUM)
        for own, quiet in zip(parts, quiet_enough(loud / most, share[0], share[1:]), strict=True):
            out[own] = not quiet
        return out


def stiffness(scene: Scene) -> Array:
    """The stiffest parameter of the material of each owned cell [Pa]. Collective."""
    out = np.ones(scene.owned_cells(None, "").size)
    for material, cells in scene.materials:
        out[cells] = max(map(abs, material.parameters.values()), default=1.0)
    return out


def quiet_enough(loud: Array, total: float, share: Array) -> Bools:
    """Parts that may freeze.

    Args:
        loud: Largest e/tol of each, over what that may become.
        total: Power D of all flexible cells.
        share: That of each part, in the same unit.
    """
    order = np.argsort(loud, kind="stable")
    left = total - np.cumsum(share[order])
    fits = np.maximum.accumulate(loud[order] * total > left * (1 + 1e-12)) == 0
    out = np.zeros(loud.size, dtype=bool)
    out[order[fits]] = True
    return out


def _over(rates: Array, tol: Array) -> float:
    """Largest e/tol; 0 where nothing strains, and more than any where nothing may."""
    loud = np.divide(rates, tol, out=np.full(rates.size, HUGE), where=tol > 0)
    return float(loud[rates > 0].max(initial=0.0))

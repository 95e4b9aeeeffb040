"""Velocities that keep joints closed: the correction by impulses of the joints.

Of all velocities that keep joints closed, D Eᵀ y = 0, those nearest to given ones in the metric of
the mass differ from them by impulses Λ of the joints,

    y - M⁻¹ E Dᵀ Λ,    (D Eᵀ M⁻¹ E Dᵀ) Λ = D Eᵀ y,

with the ports Eᵀ of `rigidfx.coupling.ports`. Rows that others imply are no harm: Λ is the least.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.coupling.ports import Ports
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.effects.joints.linkage import Linkage

__all__ = ["Closing"]

Array = npt.NDArray[np.float64]


class Closing:
    """Corrects velocities for the joints, at fixed places."""

    def __init__(
        self, linkage: Linkage, prolongation: Prolongation, solve: Callable[[Array], Array]
    ) -> None:
        """Find the effects of unit impulses. Collective.

        Args:
            linkage: The joints, at the places in question.
            prolongation: Map between unknowns and dofs there.
            solve: M⁻¹ of momenta of this rank's unknowns.
        """
        self._linkage, self._comm = linkage, prolongation.comm
        ports = Ports(prolongation, linkage)
        self._E = ports.entries
        self._D = linkage.gradient(0.0) @ ports.lead(prolongation.increments.L)
        columns = (solve(self._E[:, [k]].toarray()[:, 0]) for k in range(ports.count))
        Y = np.stack(list(columns), axis=1)
        self._by_impulses = Y @ self._D.T.toarray()
        resisted = self._D @ self._sum(self._E.T @ Y) @ self._D.T
        self._inverse = np.linalg.pinv(resisted, hermitian=True)

    def _sum(self, values: Array) -> Array:
        values = np.ascontiguousarray(values)
        self._comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def correction(self, y: Array, fixed: Array) -> Array:
        """Addition to velocities of this rank's unknowns [m/s]. Collective.

        Args:
            y: These velocities.
            fixed: Velocities of nodes that supports give, zero elsewhere, one per row [m/s].
        """
        rates = self._D @ self._sum(self._E.T @ y) + self._linkage.rates(fixed)
        return np.asarray(-self._by_impulses @ (self._inverse @ rates))

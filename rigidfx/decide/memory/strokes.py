"""The time in which a structure strains: its largest strain over its largest strain rate."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

__all__ = ["Strokes"]

Array = npt.NDArray[np.float64]


class Strokes:
    """Remembers the largest strain and the largest strain rate of flexible cells.

    Attributes:
        time: Largest strain over largest rate at the end of the last window [s]; infinite while
            nothing but rounding has strained.
        rate: Largest rate on this rank so far [1/s].
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Nothing has strained.

        Args:
            comm: Communicator of the mesh.
        """
        self._comm, self.rate, self._strain = comm, 0.0, 0.0
        self.time = np.inf

    def add(self, rates: Array) -> None:
        """Take note of the rates of a step [1/s]."""
        self.rate = max(self.rate, float(rates.max(initial=0.0)))

    def look(self, strains: Array, noise: float) -> None:
        """Take note of the end of a window. Collective.

        Args:
            strains: Of all owned cells.
            noise: Strain rate that rounding may leave [1/s].
        """
        self._strain = max(self._strain, float(strains.max(initial=0.0)))
        both = np.array([self.rate, self._strain])
        self._comm.Allreduce(MPI.IN_PLACE, both, op=MPI.MAX)
        rate, strain = both
        if rate > noise and strain > 0:
            self.time = float(strain / rate)

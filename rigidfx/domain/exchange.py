"""Numbers that pass between ranks along fixed ways: from owners to who has copies, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array

Int = PETSc.IntType


class Exchange:
    """Ways from items of all ranks to copies of them on any rank; `destroy` frees it."""

    def __init__(self, comm: MPI.Intracomm, items: int, rank: Any, place: Any) -> None:
        """Find the ways. Collective.

        Args:
            comm: The ranks.
            items: Number of this rank's items.
            rank: For each copy on this rank, the rank of its item.
            place: And the item's place there.
        """
        self._items, self._copies = items, len(rank)
        self._graph = PETSc.SF().create(comm)
        ways = np.stack([rank, place], axis=1).astype(Int)
        self._graph.setGraph(items, None, ways.reshape(-1))
        self._graph.setUp()
        # PETSc adds up its own numbers, and several together, but not a type of one of them.
        self._units: dict[int, MPI.Datatype] = {1: MPI.DOUBLE}

    def give(self, values: Array) -> Array:
        """Values of the items, at their copies. Collective.

        Args:
            values: Shape (items, k).

        Returns:
            Shape (copies, k).
        """
        out = np.empty((self._copies, values.shape[1]))
        given, unit = np.ascontiguousarray(values), self._unit(values.shape[1])
        self._graph.bcastBegin(unit, given, out, MPI.REPLACE)
        self._graph.bcastEnd(unit, given, out, MPI.REPLACE)
        return out

    def collect(self, values: Array) -> Array:
        """The sum of the values of its copies, for each item. Collective.

        Args:
            values: Shape (copies, k).

        Returns:
            Shape (items, k).
        """
        out = np.zeros((self._items, values.shape[1]))
        given, unit = np.ascontiguousarray(values), self._unit(values.shape[1])
        self._graph.reduceBegin(unit, given, out, MPI.SUM)
        self._graph.reduceEnd(unit, given, out, MPI.SUM)
        return out

    def _unit(self, numbers: int) -> MPI.Datatype:
        """So many numbers, as MPI sends them."""
        if numbers not in self._units:
            self._units[numbers] = MPI.DOUBLE.Create_contiguous(numbers).Commit()
        return self._units[numbers]

    def destroy(self) -> None:
        """Free the ways. Collective."""
        self._graph.destroy()
        for numbers in [numbers for numbers in self._units if numbers > 1]:
            self._units.pop(numbers).Free()

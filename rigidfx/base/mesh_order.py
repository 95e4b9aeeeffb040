"""Numbers of cells and nodes that do not depend on ranks: those of the mesh as it was given."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

from rigidfx.base.types import Ints


@dataclass(frozen=True)
class MeshOrder:
    """Of each cell and node of a rank its number in the mesh.

    Attributes:
        comm: Communicator of the mesh; None of another rank.
        cells: Numbers of the owned cells.
        nodes: Numbers of the local nodes, owned ones first.
        owned: Number of owned nodes.
        every_cell: Number of cells on all ranks.
        every_node: Number of nodes likewise.
        named: Effects and obstacles, which objects know by their identity; alike on all ranks.
    """

    comm: MPI.Intracomm | None
    cells: Ints
    nodes: Ints
    owned: int
    every_cell: int
    every_node: int
    named: tuple[Any, ...] = ()

    @property
    def first(self) -> bool:
        """Whether this is rank 0."""
        return self.comm is None or self.comm.rank == 0

    def of_all_ranks(self) -> list[MeshOrder]:
        """Those of all ranks, on rank 0. Collective."""
        assert self.comm is not None
        found = self.comm.gather(replace(self, comm=None, named=()))
        return [] if found is None else [self, *found[1:]]

    def numbers(self) -> dict[int, int]:
        """Place in `named` of each object, by its identity."""
        return {id(one): k for k, one in enumerate(self.named)}

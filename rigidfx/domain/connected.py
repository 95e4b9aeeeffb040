"""Connected parts of a mesh: cells joined through facets, or through vertices alone.

Each rank finds the parts of the entities it knows; an entity that two ranks share ties a part of
one to a part of the other. Parts are numbered by the least of their cells' numbers in the mesh
file, so that the partition of the mesh cannot be seen in the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import la
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.types import Array, Bools, Ints

__all__ = ["ConnectedParts", "connected_parts"]


@dataclass(frozen=True)
class ConnectedParts:
    """The connected parts of a mesh.

    Attributes:
        count: How many there are, over all ranks.
        of_cell: Part of each local cell, ghosts included.
        of_entity: Part of each local facet or vertex, whichever joins cells.
        lower: Least coordinates of each part, shape (parts, 3) [m].
        upper: Greatest coordinates of each part, shape (parts, 3) [m].
    """

    count: int
    of_cell: Ints
    of_entity: Ints
    lower: Array
    upper: Array

    def place(self, part: int) -> str:
        """Where a part is and how large, for messages.

        Args:
            part: Its number.
        """
        middle = ", ".join(f"{x:.4g}" for x in (self.lower[part] + self.upper[part]) / 2)
        size = " × ".join(f"{x:.4g}" for x in self.upper[part] - self.lower[part])
        return f"the part of {size} m around ({middle}) m"


def connected_parts(mesh: dmesh.Mesh, dim: int, among: Bools | None = None) -> ConnectedParts:
    """Find the connected parts. Collective.

    Args:
        mesh: A mesh.
        dim: Dimension of the entities through which cells are joined: 2 or 0.
        among: For each local cell, ghosts included, whether it is looked at; all are if None. The
            others count as one part together.
    """
    topology, comm = mesh.topology, mesh.comm
    topology.create_entities(dim)
    topology.create_connectivity(3, dim)
    graph = topology.connectivity(3, dim)
    cells, entities = graph.num_nodes, topology.index_map(dim)
    n = cells + entities.size_local + entities.num_ghosts
    rows, columns = np.repeat(np.arange(cells), np.diff(graph.offsets)), cells + graph.array
    if among is not None:
        rows, columns = _apart(rows, columns, among, la.vector(entities, 1, dtype=np.float64), n)
        n += 1
    links = coo_array((np.ones(rows.size), (rows, columns)), (n, n))
    found, local = connected_components(links, directed=False)
    first = comm.exscan(found) or 0
    local = local + first
    shared = la.vector(entities, 1, dtype=np.float64)
    own = local[cells : cells + shared.array.size]
    shared.array[:] = own
    shared.scatter_forward()
    ties = np.unique(np.stack([own, shared.array.astype(np.int64)]), axis=1)
    if among is not None:
        rest = [[local[-1]], [comm.bcast(int(local[-1]))]]
        ties = np.concatenate([ties, np.array(rest)], axis=1)
    a, b = np.concatenate(comm.allgather(ties[:, ties[0] != ties[1]]), axis=1)
    total = comm.allreduce(found)
    tied = coo_array((np.ones(a.size), (a, b)), (total, total))
    count, number = connected_components(tied, directed=False)
    part = number[local]
    return _numbered(mesh, int(count), part[:cells], part[cells : cells + own.size])


def _apart(
    rows: Ints,
    columns: Ints,
    among: Bools,
    marks: Any,
    rest: int,
) -> tuple[Ints, Ints]:
    """Links among some cells; all other cells, and entities of these alone, to one more node.

    Args:
        rows: Cells of the links of all.
        columns: Their entities, numbered after the cells.
        among: Of each local cell, whether it counts.
        marks: A vector over the entities, overwritten. Collective.
        rest: Number of the further node.
    """
    inside = among[rows]
    marks.array[:] = 0.0
    marks.array[columns[inside] - among.size] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    marks.scatter_forward()
    others = np.concatenate([np.flatnonzero(~among), among.size + np.flatnonzero(marks.array == 0)])
    return (
        np.concatenate([rows[inside], others]),
        np.concatenate([columns[inside], np.full(others.size, rest)]),
    )


def _numbered(mesh: dmesh.Mesh, count: int, of_cell: Ints, of_entity: Ints) -> ConnectedParts:
    """The parts in the order of the mesh file, with their extent. Collective."""
    least = np.full(count, np.iinfo(np.int64).max)
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(least, of_cell, mesh.topology.original_cell_index[: of_cell.size])
    x = mesh.geometry.x[cell_geometry_dofs(mesh)[: of_cell.size]]
    np.minimum.at(lower, of_cell, x.min(axis=1))
    np.maximum.at(upper, of_cell, x.max(axis=1))
    for values, op in ((least, MPI.MIN), (lower, MPI.MIN), (upper, MPI.MAX)):
        mesh.comm.Allreduce(MPI.IN_PLACE, values, op=op)
    order = np.argsort(least)
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    return ConnectedParts(count, rank[of_cell], rank[of_entity], lower[order], upper[order])

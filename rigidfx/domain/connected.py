"""Parts of a mesh: connected through facets, or through vertices alone as hinges, or touching.

Parts are numbered by the least of their cells' numbers in the mesh file, so that the partition of
the mesh cannot be seen in the result. Others share no nodes and touch or overlap nonetheless: of
two cells that meet, an edge of one passes through the other, lies in it, or grazes it. So the edges
on the surface of each part are cut with the planes of facets of others' cells; those of hexahedra
stand for planes parallel to both diagonals.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import basix
import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import la
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.types import Array, Bools, Ints

STRAIGHT = 1e-6  # of the length of a row of nodes: how far beside a line they may lie
COINCIDENT = 1e-6  # of the size of a cell; what is further apart than that does not touch
AT_ONCE = 4096  # edges whose cells are looked at together


def touching(mesh: dmesh.Mesh, parts: ConnectedParts, group: Ints) -> Ints:
    """Pairs of parts that touch, sorted, shape (2, pairs). Collective.

    Between parts of the same `group` nothing is looked for.
    """
    found = mesh.comm.allgather(_edges(mesh, parts))
    ends = np.concatenate([points for points, _ in found])
    part = np.concatenate([numbers for _, numbers in found])
    pairs = [np.empty((0, 2), np.int64)]
    owned = mesh.topology.index_map(3).size_local
    if owned and part.size:
        corners = mesh.geometry.x[cell_geometry_dofs(mesh)[:owned]]
        for edges, cells in _near(ends, corners):
            a, b = part[edges], parts.of_cell[cells]
            wanted = group[a] != group[b]
            edges, cells = edges[wanted], cells[wanted]
            meets = _meets(mesh, corners[cells], ends[edges])
            pairs.append(np.unique(np.stack([a, b], axis=1)[wanted][meets], axis=0))
    every = mesh.comm.allgather(np.concatenate(pairs))
    return np.unique(np.sort(np.concatenate(every), axis=1), axis=0).T.reshape(2, -1)


def _edges(mesh: dmesh.Mesh, parts: ConnectedParts) -> tuple[Array, Ints]:
    """Edges of this rank's boundary facets by their ends, shape (n, 2, 3), and their parts."""
    topology = mesh.topology
    topology.create_entities(1)
    for one, other in ((2, 3), (2, 1), (1, 0), (1, 3)):
        topology.create_connectivity(one, other)
    facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)
    if not facets.size:  # a rank may own nothing, which DOLFINx divides by
        return np.empty((0, 2, 3)), np.empty(0, np.int64)
    own = dmesh.compute_incident_entities(topology, facets, 2, 1).astype(np.int32)
    nodes = dmesh.entities_to_geometry(mesh, 1, own)[:, :2]  # without nodes between them
    first = topology.connectivity(1, 0)
    return mesh.geometry.x[nodes], parts.of_entity[first.array[first.offsets[own]]]


def _near(ends: Array, corners: Array) -> Iterator[tuple[Ints, Ints]]:
    """Edges, shape (n, 2, 3), and cells, (n, corners, 3), whose boxes overlap, some at a time."""
    margin = COINCIDENT * np.ptp(corners, axis=1).max(axis=1)[:, None]
    lower, upper = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    tree = KDTree((lower + upper) / 2)
    reach = float(np.linalg.norm(upper - lower, axis=1).max()) / 2
    least, most = ends.min(axis=1), ends.max(axis=1)
    around = np.flatnonzero(
        ((most >= lower.min(axis=0)) & (least <= upper.max(axis=0))).all(axis=1)
    )
    for some in np.array_split(around, max(1, -(-around.size // AT_ONCE))):
        radius = np.linalg.norm(most[some] - least[some], axis=1) / 2 + reach
        hits = tree.query_ball_point((least[some] + most[some]) / 2, radius)
        edges = np.repeat(some, [len(own) for own in hits])
        cells = np.concatenate([np.empty(0, np.int64), *(np.asarray(h, np.int64) for h in hits)])
        over = ((most[edges] >= lower[cells]) & (least[edges] <= upper[cells])).all(axis=1)
        yield edges[over], cells[over]


def _meets(mesh: dmesh.Mesh, corners: Array, ends: Array) -> Bools:
    """Whether some point of an edge, shape (n, 2, 3), lies in its cell, (n, corners, 3)."""
    margin = COINCIDENT * np.ptp(corners, axis=1).max(axis=1)
    begin: Array = np.zeros(len(ends))  # what is left of each edge, from 0 ...
    end: Array = np.ones(len(ends))  # ... to 1
    middle = corners.mean(axis=1)
    for facet in basix.topology(basix.CellType[mesh.topology.cell_type.name])[2]:
        p = corners[:, facet]
        across = (p[:, -1] - p[:, 0], p[:, -2] - p[:, 1 if len(facet) == 4 else 0])
        normal = np.cross(*across)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        centre = p.mean(axis=1)
        outwards = np.sign(np.einsum("ni,ni->n", normal, centre - middle))
        heights = np.einsum("ni,nki->nk", normal, ends - centre[:, None]) * outwards[:, None]
        a, b = (heights - margin[:, None]).T  # above the facet where positive
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = a / (a - b)
        begin = np.where(a > 0, np.where(b > 0, np.inf, np.fmax(begin, crossing)), begin)
        end = np.where((b > 0) & (a <= 0), np.fmin(end, crossing), end)
    return begin <= end


@dataclass(frozen=True)
class Hinge:
    """Vertices that two parts share."""

    parts: tuple[int, int]  # numbers of both parts
    nodes: Array  # positions of the vertices, shape (n, 3) [m]

    def __str__(self) -> str:
        """How many vertices, of which shape, and where."""
        arms = self.nodes - self.nodes.mean(axis=0)
        middle = ", ".join(f"{x:.4g}" for x in self.nodes.mean(axis=0))
        sizes = np.linalg.svd(arms, compute_uv=False)
        if len(self.nodes) == 1:
            return f"one node at ({middle}) m"
        kind = "nodes" if sizes[1] > STRAIGHT * sizes[0] else "nodes of one edge"
        return f"{len(self.nodes)} {kind} around ({middle}) m"


def hinges(mesh: dmesh.Mesh, parts: ConnectedParts) -> list[Hinge]:
    """Find the vertices that parts share, a record for each pair of parts. Collective."""
    topology = mesh.topology
    topology.create_connectivity(2, 3)
    topology.create_connectivity(2, 0)
    topology.create_connectivity(0, 3)
    facets = np.asarray(dmesh.exterior_facet_indices(topology), dtype=np.int32)
    found = np.empty((0, 2), np.int64)
    x = np.empty((0, 3))
    if facets.size:
        skin = dmesh.compute_incident_entities(topology, facets, 2, 0).astype(np.int32)
        cells = topology.connectivity(0, 3)
        starts, ends = cells.offsets[skin], cells.offsets[skin + 1]
        number = topology.index_map(0).local_to_global(skin)
        at = np.concatenate([cells.array[a:b] for a, b in zip(starts, ends, strict=True)])
        rows = np.repeat(np.arange(skin.size), ends - starts)
        pairs = np.unique(np.stack([rows, parts.of_cell[at]], axis=1), axis=0)
        nodes = dmesh.entities_to_geometry(mesh, 0, skin).reshape(-1)
        found = np.stack([number[pairs[:, 0]], pairs[:, 1]], axis=1)
        x = mesh.geometry.x[nodes[pairs[:, 0]]]
    every = mesh.comm.allgather((found, x))
    found, first = np.unique(np.concatenate([f for f, _ in every]), axis=0, return_index=True)
    x = np.concatenate([own for _, own in every])[first]
    _, begin, count = np.unique(found[:, 0], return_index=True, return_counts=True)
    shared: dict[tuple[int, int], list[Array]] = {}
    for k in np.flatnonzero(count > 1):
        mine = [int(part) for part in found[begin[k] : begin[k] + count[k], 1]]
        for i, a in enumerate(mine):
            for b in mine[i + 1 :]:
                shared.setdefault((a, b), []).append(x[begin[k]])
    # Positions in an order that does not depend on the partition.
    return [
        Hinge(pair, np.array(sorted(map(tuple, points)))) for pair, points in sorted(shared.items())
    ]


@dataclass(frozen=True)
class ConnectedParts:
    """The connected parts of a mesh."""

    count: int  # how many there are, over all ranks
    of_cell: Ints  # part of each local cell, ghosts included
    of_entity: Ints  # part of each local facet or vertex, whichever joins cells
    lower: Array  # least coordinates of each part, shape (parts, 3) [m]
    upper: Array  # greatest coordinates of each part, shape (parts, 3) [m]

    @property
    def middle(self) -> Array:
        """Middle of the box of each, shape (parts, 3) [m]."""
        return 0.5 * (self.lower + self.upper)

    @property
    def size(self) -> Array:
        """Diagonal of the box of each, shape (parts,) [m]."""
        return np.asarray(np.linalg.norm(self.upper - self.lower, axis=1))

    @property
    def extent(self) -> float:
        """Diagonal of the box of all [m]."""
        return float(np.linalg.norm(self.upper.max(axis=0) - self.lower.min(axis=0)))

    def place(self, part: int) -> str:
        """Where a part is and how large, for messages."""
        middle = ", ".join(f"{x:.4g}" for x in (self.lower[part] + self.upper[part]) / 2)
        size = " × ".join(f"{x:.4g}" for x in self.upper[part] - self.lower[part])
        return f"the part of {size} m around ({middle}) m"


def connected_parts(mesh: dmesh.Mesh, dim: int, among: Bools | None = None) -> ConnectedParts:
    """Find the parts of cells connected through entities of dimension 2 or 0. Collective.

    Local cells, ghosts included, that are not `among` those looked at count as one part together.
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


def _apart(rows: Ints, columns: Ints, among: Bools, marks: Any, rest: int) -> tuple[Ints, Ints]:
    """Links among some local cells; all others, and entities of these alone, to one node `rest`.

    Columns are entities, numbered after all cells; `marks`, a vector over them, is overwritten.
    Collective.
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

"""Parts of a mesh that share no nodes and touch or overlap nonetheless.

Of two cells that meet, an edge of one passes through the other, or lies in it, or grazes it. So the
edges on the surface of each part are cut with the cells of others: with the planes of their facets,
of which those of hexahedra need not be flat and stand for planes parallel to both diagonals.
"""

from __future__ import annotations

from collections.abc import Iterator

import basix
import dolfinx.mesh as dmesh
import numpy as np
from scipy.spatial import KDTree

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.domain.connected import ConnectedParts

__all__ = ["touching"]

COINCIDENT = 1e-6  # of the size of a cell; what is further apart than that does not touch
AT_ONCE = 4096  # edges whose cells are looked at together


def touching(mesh: dmesh.Mesh, parts: ConnectedParts, group: Ints) -> Ints:
    """Pairs of parts that touch, sorted, shape (2, pairs). Collective.

    Args:
        mesh: The mesh.
        parts: Its connected parts.
        group: A number for each part; between parts with the same one, nothing is looked for.
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
    """Edges and cells whose boxes overlap, some at a time.

    Args:
        ends: Of edges, shape (edges, 2, 3).
        corners: Of cells, shape (cells, corners, 3).
    """
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
    """Whether some point of an edge lies in a cell, or on it.

    Args:
        mesh: For the kind of its cells.
        corners: Of one cell for each edge, shape (n, corners, 3).
        ends: Of the edges, shape (n, 2, 3).
    """
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

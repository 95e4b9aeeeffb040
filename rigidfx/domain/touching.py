"""Parts of a mesh that share no nodes and touch or overlap nonetheless.

A vertex, or the middle of a facet, on the surface of a part touches another part where it lies in
one of its cells. Which cells may hold it is asked of a tree of boxes, the rest of planes: of the
facets of hexahedra, which need not be flat, those parallel to both diagonals through the middle.
Edges that cross, with no such point of either part in the other, are not found.
"""

from __future__ import annotations

import basix
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from dolfinx import geometry

from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.domain.connected import ConnectedParts

__all__ = ["touching"]

COINCIDENT = 1e-6  # of the size of a cell; what is further apart than that does not touch

Array = npt.NDArray[np.float64]
Labels = npt.NDArray[np.int64]


def touching(
    mesh: dmesh.Mesh, parts: ConnectedParts, group: Labels, loose: npt.NDArray[np.bool_]
) -> Labels:
    """Pairs of parts that touch, sorted, shape (2, pairs). Collective.

    Args:
        mesh: The mesh.
        parts: Its connected parts.
        group: A number for each part; between parts with the same one, nothing is looked for.
        loose: Whether a part is one that matters; one of each pair is.
    """
    found = mesh.comm.allgather(_surface(mesh, parts))
    x = np.concatenate([points for points, _ in found])
    part = np.concatenate([numbers for _, numbers in found])
    pairs = np.empty((0, 2), np.int64)
    owned = mesh.topology.index_map(3).size_local
    if owned and x.size:
        cells = np.arange(owned, dtype=np.int32)
        corners = mesh.geometry.x[cell_geometry_dofs(mesh)[:owned]]
        margin = COINCIDENT * float(np.ptp(corners, axis=1).max())
        tree = geometry.bb_tree(mesh, 3, entities=cells, padding=margin)
        boxed = geometry.compute_collisions_points(tree, x)
        points = np.repeat(np.arange(len(x)), np.diff(boxed.offsets))
        a, b = part[points], parts.of_cell[boxed.array]
        wanted = (group[a] != group[b]) & (loose[a] | loose[b])
        points, near = points[wanted], boxed.array[wanted]
        inside = _inside(mesh, corners[near], x[points])
        pairs = np.unique(np.stack([a, b], axis=1)[wanted][inside], axis=0)
    pairs = np.sort(np.concatenate(mesh.comm.allgather(pairs)), axis=1)
    return np.unique(pairs, axis=0).T.reshape(2, -1)


def _surface(mesh: dmesh.Mesh, parts: ConnectedParts) -> tuple[Array, Labels]:
    """Vertices and middles of this rank's boundary facets, shape (n, 3), and their parts."""
    mesh.topology.create_connectivity(2, 3)
    mesh.topology.create_connectivity(2, 0)
    mesh.topology.create_connectivity(0, 3)
    facets = np.asarray(dmesh.exterior_facet_indices(mesh.topology), dtype=np.int32)
    if not facets.size:  # a rank may own nothing, which DOLFINx divides by
        return np.empty((0, 3)), np.empty(0, np.int64)
    own = dmesh.compute_incident_entities(mesh.topology, facets, 2, 0).astype(np.int32)
    nodes = dmesh.entities_to_geometry(mesh, 0, own).reshape(-1)
    first = mesh.topology.connectivity(2, 3)
    cells = first.array[first.offsets[facets]]
    x = np.concatenate([mesh.geometry.x[nodes], dmesh.compute_midpoints(mesh, 2, facets)])
    return x, np.concatenate([parts.of_entity[own], parts.of_cell[cells]])


def _inside(mesh: dmesh.Mesh, corners: Array, x: Array) -> npt.NDArray[np.bool_]:
    """Whether points lie in cells, or on them.

    Args:
        mesh: For the kind of its cells.
        corners: Of one cell for each point, shape (n, corners, 3).
        x: Points, shape (n, 3).
    """
    margin = COINCIDENT * np.ptp(corners, axis=1).max(axis=1)
    inside = np.ones(len(x), dtype=bool)
    middle = corners.mean(axis=1)
    for facet in basix.topology(basix.CellType[mesh.topology.cell_type.name])[2]:
        p = corners[:, facet]
        across = (p[:, -1] - p[:, 0], p[:, -2] - p[:, 1 if len(facet) == 4 else 0])
        normal = np.cross(*across)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        centre = p.mean(axis=1)
        outwards = np.sign(np.einsum("ni,ni->n", normal, centre - middle))
        height = np.einsum("ni,ni->n", normal, x - centre) * outwards
        inside &= height <= margin
    return inside

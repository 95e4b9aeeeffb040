"""Edges that a marker names, or between some vertices; entities by the given numbers of nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import la

from rigidfx.base import compat
from rigidfx.base.types import Indices, Ints


def nodes_of(mesh: dmesh.Mesh, dim: int, entities: Indices) -> Indices:
    """Nodes of the geometry in the closure of entities, corners first. Collective.

    Args:
        mesh: A mesh.
        dim: Dimension of the entities.
        entities: Their local numbers; a rank may have none.

    Returns:
        A row for each, shape (entities, nodes).
    """
    mesh.topology.create_entities(dim)
    for one, other in ((dim, 3), (3, dim)):
        mesh.topology.create_connectivity(one, other)
    if not entities.size:  # which DOLFINx divides by
        layout = compat.coordinate_map(mesh).create_dof_layout()
        return np.empty((0, layout.num_entity_closure_dofs(dim)), np.int32)
    return np.asarray(dmesh.entities_to_geometry(mesh, dim, entities))


def by_corners(mesh: dmesh.Mesh, dim: int, named: Mapping[str, Ints]) -> dict[str, Indices]:
    """Local entities with given corners, ghosts included, by name. Collective.

    Corners that are those of no entity are left out.

    Args:
        mesh: A mesh.
        dim: Dimension of the entities.
        named: Name → corners by their numbers in the input, in any order, shape (entities,
            corners); the same on all ranks.
    """
    mesh.topology.create_entities(dim)
    known = mesh.topology.index_map(dim)
    every = np.arange(known.size_local + known.num_ghosts, dtype=np.int32)
    numbers = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    nodes = numbers[nodes_of(mesh, dim, every)]
    found = {}
    for name, corners in named.items():
        own = np.sort(nodes[:, : corners.shape[1]], axis=1)
        likely = np.flatnonzero(np.isin(own, corners).all(axis=1))  # few as a rule
        both = np.concatenate([np.sort(corners, axis=1), own[likely]])
        _, which = np.unique(both, axis=0, return_inverse=True)
        wanted, which = np.split(which.reshape(-1), [len(corners)])
        found[name] = every[likely[np.isin(which, wanted)]]
    return found


def edges_within(mesh: dmesh.Mesh, dim: int, marker: Callable[[Any], Any]) -> Indices:
    """Local edges with both ends and the middle in a marker, ghosts included.

    An edge across a corner has both ends on the rim of a face, and its middle inside.

    Args:
        mesh: A mesh that knows its edges.
        dim: 1, as `dolfinx.mesh.locate_entities` has it.
        marker: Function of x, shape (3, n) [m], to booleans of shape (n,).
    """
    edges = dmesh.locate_entities(mesh, dim, marker)
    nodes = nodes_of(mesh, dim, edges)  # both ends, then the middle of a curved one
    middles = mesh.geometry.x[nodes[:, 2:] if nodes.shape[1] > 2 else nodes].mean(axis=1)
    return np.asarray(edges[marker(middles.T)])


def count_loose(mesh: dmesh.Mesh, vertices: Indices, edges: Indices) -> int:
    """Number of vertices at which none of the edges ends. Collective."""
    mesh.topology.create_connectivity(1, 0)
    marks = la.vector(mesh.topology.index_map(0), 1, dtype=np.float64)
    marks.array[dmesh.compute_incident_entities(mesh.topology, edges, 1, 0)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    own = vertices[vertices < mesh.topology.index_map(0).size_local]
    return int(mesh.comm.allreduce(int(np.count_nonzero(marks.array[own] == 0.0))))


def count_between(mesh: dmesh.Mesh, vertices: Indices) -> int:
    """Number of edges with both ends among some vertices. Collective."""
    mesh.topology.create_entities(1)
    mesh.topology.create_connectivity(1, 0)
    owned = mesh.topology.index_map(1).size_local
    ends = mesh.topology.connectivity(1, 0).array[: 2 * owned].reshape(-1, 2)
    return int(mesh.comm.allreduce(int(np.count_nonzero(np.isin(ends, vertices).all(axis=1)))))

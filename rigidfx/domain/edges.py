"""Edges of a mesh and their ends: which a marker names, and which lie between some vertices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import la

from rigidfx.base.types import Indices
from rigidfx.domain.numbered import nodes_of

__all__ = ["count_between", "count_loose", "edges_within"]


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
    """Number of vertices at which none of the edges ends. Collective.

    Args:
        mesh: The mesh.
        vertices: Local vertices, ghosts included.
        edges: Local edges, ghosts included.
    """
    mesh.topology.create_connectivity(1, 0)
    marks = la.vector(mesh.topology.index_map(0), 1, dtype=np.float64)
    marks.array[dmesh.compute_incident_entities(mesh.topology, edges, 1, 0)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    own = vertices[vertices < mesh.topology.index_map(0).size_local]
    return int(mesh.comm.allreduce(int(np.count_nonzero(marks.array[own] == 0.0))))


def count_between(mesh: dmesh.Mesh, vertices: Indices) -> int:
    """Number of edges with both ends among some vertices. Collective.

    Args:
        mesh: The mesh.
        vertices: Local vertices, ghosts included.
    """
    mesh.topology.create_entities(1)
    mesh.topology.create_connectivity(1, 0)
    owned = mesh.topology.index_map(1).size_local
    ends = mesh.topology.connectivity(1, 0).array[: 2 * owned].reshape(-1, 2)
    return int(mesh.comm.allreduce(int(np.count_nonzero(np.isin(ends, vertices).all(axis=1)))))

"""Entities of a mesh by the numbers that their nodes have in the input it was made of."""

from __future__ import annotations

from collections.abc import Mapping

import dolfinx.mesh as dmesh
import numpy as np

from rigidfx.base import compat
from rigidfx.base.types import Indices, Ints

__all__ = ["by_corners", "nodes_of"]


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

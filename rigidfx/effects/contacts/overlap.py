"""Where a mesh overlaps itself at a surface that may meet itself.

There the gap tells nothing: a node behind a triangle in the reference is taken for the other side
of a thin wall. But a point inside a cell is in no other cell of a sound mesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import geometry
from dolfinx import mesh as dmesh

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.errors import SceneError, agree
from rigidfx.base.types import Array
from rigidfx.effects.contacts.surface import triangles_of

__all__ = ["refuse_overlap"]

INSIDE = 0.1  # of the way from a triangle to the middle of the cell behind: surfaces may touch


def refuse_overlap(scene: Any, where: str, owner: str) -> None:
    """Refuse a surface behind which there are cells in cells. Collective.

    Args:
        scene: The problem.
        where: Name of a set of boundary facets.
        owner: Who asks, for messages.

    Raises:
        SceneError: On every rank, with the places, if there are such cells.
    """
    comm, X = scene.comm, scene.space.tabulate_dof_coordinates()
    cells, triangles = triangles_of(scene, where, owner)
    dofmap = scene.space.dofmap
    dofs, number = dofmap.list, dofmap.index_map.local_to_global
    on = X[triangles].mean(axis=1)
    inside = on + INSIDE * (X[dofs[cells]].mean(axis=1) - on)
    each = dofs.shape[1]  # a rank may have none of the facets, or no cell at all
    of_cells = number(dofs[cells].reshape(-1).astype(np.int32)).reshape(-1, each)
    points = np.concatenate(comm.allgather(inside))
    nodes = np.concatenate(comm.allgather(of_cells))
    point, cell = _hits(scene.mesh, points)
    hit = number(dofs[cell].reshape(-1).astype(np.int32)).reshape(-1, each)
    shared = np.zeros(point.size, dtype=bool)
    for a in range(hit.shape[1]):  # nodes of one cell
        shared |= (nodes[point] == hit[:, a, None]).any(axis=1)
    point, cell = point[~shared], cell[~shared]
    held = [_holds(scene.mesh, c, points[p]) for p, c in zip(point, cell, strict=True)]
    every = np.unique(np.concatenate(comm.allgather(point[np.array(held, dtype=bool)])))
    problem = None
    if every.size:
        x, y, z = points[every[0]]
        problem = (
            f"{owner}: the mesh overlaps itself at ({x:.6g}, {y:.6g}, {z:.6g}) m, and behind "
            f"{every.size} of {len(points)} triangles of '{where}' in all: a surface that may meet "
            "itself has to begin free of itself. Move its parts out of each other."
        )
    agree(comm, problem, SceneError)


def _hits(mesh: Any, points: Array) -> tuple[Any, Any]:
    """Points, and owned cells whose convex hulls they are in, by numbers, one for each pair."""
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    if not owned.size or not len(points):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    tree = geometry.bb_tree(mesh, 3, entities=owned)
    candidates = geometry.compute_collisions_points(tree, points)
    hits = geometry.compute_colliding_cells(mesh, candidates, points)
    return np.repeat(np.arange(len(points)), np.diff(hits.offsets)), hits.array


def _holds(mesh: Any, cell: int, point: Array) -> bool:
    """Whether a point is in a cell, which may be smaller than its hull; few are asked for."""
    corners = mesh.geometry.x[cell_geometry_dofs(mesh)[cell]]
    try:
        X = coordinate_map(mesh).pull_back(point.reshape(1, 3), corners)
    except RuntimeError:  # nowhere near: no such place is found
        return False
    simplex = mesh.topology.cell_type == dmesh.CellType.tetrahedron
    return bool((X > 0).all() and (X.sum() < 1 if simplex else (X < 1).all()))

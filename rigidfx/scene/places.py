"""Which cell holds a named point of a scene."""

from __future__ import annotations

from collections.abc import Mapping
from sys import maxsize

import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import geometry
from mpi4py import MPI

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array

__all__ = ["cells_of"]


def cells_of(mesh: dmesh.Mesh, points: Mapping[str, Array]) -> dict[str, tuple[int, int]]:
    """Rank and local number of the cell that holds each point, the same on all ranks. Collective.

    Of several cells that share a point it is the first one of the mesh file, on any ranks.

    Args:
        mesh: The mesh.
        points: Points by name, shape (3,) each [m].

    Raises:
        SceneError: On every rank, if one lies in no cell.
    """
    if not points:
        return {}
    X = np.stack([*points.values()])
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    # A corner of a mesh may be a rounding away from where its name says.
    largest = max(np.abs(X).max(), np.abs(mesh.geometry.x).max(initial=0.0))
    room = 10 * np.finfo(float).eps * largest
    tree = geometry.bb_tree(mesh, 3, entities=owned, padding=room)
    candidates = geometry.compute_collisions_points(tree, X)
    hits = geometry.compute_colliding_cells(mesh, candidates, X)
    numbers, found = mesh.topology.original_cell_index, {}
    for k, name in enumerate(points):
        cell = min(map(int, hits.links(k)), key=lambda c: numbers[c], default=-1)
        number = int(numbers[cell]) if cell >= 0 else maxsize
        ends = mesh.comm.allgather((number, mesh.comm.rank, cell))
        first, rank, local = min(ends)
        if first == maxsize:
            x = mesh.geometry.x
            low = [mesh.comm.allreduce(float(v), op=MPI.MIN) for v in x.min(0, initial=np.inf)]
            high = [mesh.comm.allreduce(float(v), op=MPI.MAX) for v in x.max(0, initial=-np.inf)]
            distance, nearest = _nearest(mesh, X[k])
            raise SceneError(
                f"Scene: the probe '{name}' at {tuple(map(float, X[k]))} m lies in no cell: it is "
                f"{distance:.3g} m outside, and the nearest point of the mesh is {nearest} m. The "
                f"mesh reaches from {tuple(low)} to {tuple(high)} m."
            )
        found[name] = rank, local
    return found


def _nearest(mesh: dmesh.Mesh, point: Array) -> tuple[float, tuple[float, ...]]:
    """Distance of a point from the mesh [m], and the nearest point of it [m]. Collective.

    Cells with curved edges are taken by their corners.
    """
    owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    offer: tuple[float, ...] = (np.inf, 0.0, 0.0, 0.0)
    if owned.size:
        tree = geometry.bb_tree(mesh, 3, entities=owned)
        middles = geometry.create_midpoint_tree(mesh, 3, owned)
        cell = geometry.compute_closest_entity(tree, middles, mesh, point[None])[0]
        corners = dmesh.entities_to_geometry(mesh, 3, np.array([cell], dtype=np.int32))[0]
        x = mesh.geometry.x[corners[: 4 if mesh.topology.cell_name() == "tetrahedron" else 8]]
        apart = geometry.compute_distance_gjk(x, point[None])
        x0, x1, x2 = map(float, (point + apart).round(12))
        offer = float(np.linalg.norm(apart)), x0, x1, x2
    distance, *place = min(mesh.comm.allgather(offer))
    return distance, tuple(place)

"""Histories of named points: fixed weights on the nodes of the cell that holds each point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import geometry

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.errors import SceneError
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Probes"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """A point of the body as a weighted sum of nodes.

    Attributes:
        nodes: Those nodes of its cell that this rank owns.
        weights: Shape functions there.
    """

    nodes: npt.NDArray[np.int64]
    weights: Array


class Probes:
    """Displacements of the named points of a scene."""

    def __init__(self, scene: Scene) -> None:
        """Find the cells that hold the points. Collective.

        Raises:
            SceneError: If a point lies in no cell.
        """
        self._scene = scene
        names, points = list(scene.probes), list(scene.probes.values())
        self._probes: dict[str, Probe] = {}
        if not names:
            return
        owned = scene.mesh.topology.index_map(3).size_local
        X = np.asarray(points).reshape(-1, 3)
        tree = geometry.bb_tree(scene.mesh, 3, entities=np.arange(owned, dtype=np.int32))
        candidates = geometry.compute_collisions_points(tree, X)
        hits = geometry.compute_colliding_cells(scene.mesh, candidates, X)
        for k, name in enumerate(names):
            cell = int(hits.links(k)[0]) if len(hits.links(k)) else -1
            holders = [r for r, c in enumerate(scene.comm.allgather(cell)) if c >= 0]
            if not holders:
                raise SceneError(
                    f"Scene: the probe '{name}' at {tuple(points[k])} m lies in no cell."
                )
            mine = _weights(scene, cell, points[k]) if holders[0] == scene.comm.rank else None
            self._probes[name] = _owned(scene, *scene.comm.bcast(mine, root=holders[0]))

    def displacements(self, state: State) -> Mapping[str, Array]:
        """Displacement of each point, shape (3,) [m]. Collective."""
        if not self._probes:
            return {}
        points = self._probes.values()
        local = [p.weights @ (state.positions(p.nodes) - state.X[p.nodes]) for p in points]
        return dict(zip(self._probes, np.asarray(self._scene.sum(np.stack(local))), strict=True))


def _weights(scene: Scene, cell: int, point: Array) -> tuple[npt.NDArray[np.int64], Array]:
    """Global nodes of a cell and their shape functions at a point of it."""
    mesh, element = scene.mesh, scene.space.element
    corners = mesh.geometry.x[cell_geometry_dofs(mesh)[cell]]
    reference = coordinate_map(mesh).pull_back(point.reshape(1, 3), corners)
    scalar: Any = element.basix_element
    weights = scalar.tabulate(0, reference)[0, 0, :, 0]
    nodes = scene.space.dofmap.cell_dofs(cell).astype(np.int32)
    return scene.space.dofmap.index_map.local_to_global(nodes), weights


def _owned(scene: Scene, nodes: npt.NDArray[np.int64], weights: Array) -> Probe:
    """The part of a weighted sum of global nodes that this rank owns."""
    first, end = scene.space.dofmap.index_map.local_range
    mine = (nodes >= first) & (nodes < end)
    return Probe(nodes[mine] - first, weights[mine])

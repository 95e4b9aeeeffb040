"""Histories of named points: fixed weights on the nodes of the cell that holds each point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.flexible.nodal_stress import material_groups
from rigidfx.report.probe_stress import Holder, ProbeStress, StressAt
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
    """Displacements of the named points of a scene, and stresses there when they are asked for."""

    def __init__(self, scene: Scene) -> None:
        """Find the nodes of the cells that hold the points. Collective."""
        self._scene = scene
        self._probes: dict[str, Probe] = {}
        self._holders: dict[str, Holder] = {}
        groups = material_groups(scene)
        for name, (root, cell) in scene.probe_cells.items():
            mine = None
            if root == scene.comm.rank:
                weights = _weights(scene, cell, scene.probes[name])
                mine = Holder(*weights, int(groups[cell]))
            self._holders[name] = found = scene.comm.bcast(mine, root=root)
            self._probes[name] = _owned(scene, found.nodes, found.weights)

    def displacements(self, state: State) -> Mapping[str, Array]:
        """Displacement of each point, shape (3,) [m]. Collective."""
        if not self._probes:
            return {}
        points = self._probes.values()
        local = [p.weights @ (state.positions(p.nodes) - state.X[p.nodes]) for p in points]
        return dict(zip(self._probes, np.asarray(self._scene.sum(np.stack(local))), strict=True))

    def stresses(self, state: State) -> Mapping[str, StressAt]:
        """Stress and strain at each point; compiled when first asked for. Collective."""
        return self._stress.measure(state) if self._probes else {}

    @cached_property
    def _stress(self) -> ProbeStress:
        return ProbeStress(self._scene, self._holders)


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

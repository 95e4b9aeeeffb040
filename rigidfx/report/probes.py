"""Histories of named points: fixed weights on the nodes of the cell that holds each point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from rigidfx.base.types import Array, Ints
from rigidfx.flexible.nodal_stress import material_groups
from rigidfx.flexible.stress import Added
from rigidfx.report.probe_stress import Holder, ProbeStress, Strained, StressAt
from rigidfx.scene.points import Point, owned_part, weights_at
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Probes"]


class Probes:
    """Displacements of the named points of a scene, and stresses there when they are asked for."""

    def __init__(self, scene: Scene) -> None:
        """Find the nodes of the cells that hold the points. Collective."""
        self._scene = scene
        self._probes: dict[str, Point] = {}
        self._holders: dict[str, Holder] = {}
        groups = material_groups(scene)
        for name, (root, cell) in scene.probe_cells.items():
            mine = None
            if root == scene.comm.rank:
                weights = weights_at(scene, cell, scene.probes[name])
                mine = Holder(*weights, int(groups[cell]))
            self._holders[name] = found = scene.comm.bcast(mine, root=root)
            self._probes[name] = owned_part(scene, found.nodes, found.weights)
        each = list(self._probes.values())
        self._nodes = np.concatenate([np.empty(0, np.int64), *(p.nodes for p in each)])
        self._weights = block_diag(*(p.weights[None] for p in each))

    def displacements(self, state: State) -> Mapping[str, Array]:
        """Displacement of each point, shape (3,) [m]. Collective."""
        return self._summed(lambda nodes: state.positions(nodes) - state.X[nodes])

    def velocities(self, state: State) -> Mapping[str, Array]:
        """Velocity of each point, shape (3,) [m/s]. Collective."""
        return self._summed(state.velocities)

    @property
    def points(self) -> Mapping[str, Point]:
        """Nodes of this rank and their weights, of each probe."""
        return self._probes

    def _summed(self, at: Callable[[Ints], Array]) -> Mapping[str, Array]:
        """Weighted sums of vectors at the nodes round each point. Collective."""
        if not self._probes:
            return {}
        sums = self._scene.sum(self._weights @ at(self._nodes))
        return dict(zip(self._probes, np.asarray(sums), strict=True))

    def stresses(
        self, state: State, strained: Strained | None = None, added: Added | None = None
    ) -> Mapping[str, StressAt]:
        """Stress and strain at each point; compiled when first asked for. Collective.

        Args:
            state: Where the structure is.
            strained: Withheld strains of rigid cells, if known.
            added: Further strains of cells.
        """
        return self._stress.measure(state, strained, added) if self._probes else {}

    @cached_property
    def _stress(self) -> ProbeStress:
        return ProbeStress(self._scene, self._holders)

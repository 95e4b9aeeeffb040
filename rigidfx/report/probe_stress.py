"""Values at probes: histories of named points, and stress and strain from the cells around them.

All weights are constant: the displacement of a probe is one fixed sum over the nodes of its cell,
its stress one over the integration points of cells that share a node with that, which alone are
evaluated. Stresses of rigid parts are recovered where one of these cells is rigid.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from dolfinx import fem, la
from scipy.linalg import block_diag

from rigidfx.base.sealed import Sealed
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.flexible.nodal_stress import extrapolation, material_groups
from rigidfx.flexible.stress import Added, PointStress, Recovered, tensors, von_mises
from rigidfx.scene.points import Point, owned_part, weights_at
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.withheld.recovery import Carried

Strained = Callable[[], Carried]


@dataclass(frozen=True)
class Holder:
    """The cell that holds a point, the same record on all ranks."""

    nodes: Ints  # global numbers of its nodes
    weights: Array  # shape functions at the point
    material: int  # number of its material among `material_groups`


@dataclass(frozen=True)
class StressAt(Sealed):
    """Stress and strain at a point, from nodal values of the material of its cell.

    Attributes:
        stress: Cauchy stress, shape (3, 3) [Pa].
        strain: Green-Lagrange strain, in the axes of the undeformed body, shape (3, 3).
        recovered: Whether a cell around the point is rigid and its withheld strain is known, see
            `rigidfx.recovered_stress`.
    """

    stress: Array
    strain: Array
    recovered: bool = False

    @property
    def von_mises(self) -> float:
        """Von Mises' equivalent stress [Pa]."""
        return float(von_mises(self.stress))


class ProbeStress:
    """Stress and strain at the probes of a scene."""

    def __init__(self, scene: Scene, holders: Mapping[str, Holder]) -> None:
        """Compile the expressions and find the cells around the probes. Collective."""
        self._scene, self._names = scene, tuple(holders)
        self._points, self._more = PointStress(scene), fem.Function(scene.space)
        patches = [self._patch(holder) for holder in holders.values()]
        self._cells = np.concatenate([cells for cells, _ in patches])
        self._weights = np.concatenate([weights for _, weights in patches])
        self._of = np.repeat(np.arange(len(patches)), [cells.size for cells, _ in patches])
        self._wanted = self._nodes_around()
        self._nodes = np.flatnonzero(self._wanted)

    def _patch(self, holder: Holder) -> tuple[Indices, Array]:
        """Owned cells around a probe, and the weight of each of their integration points."""
        scene = self._scene
        table = scene.space.dofmap.list[: scene.mesh.topology.index_map(3).size_local]
        local = scene.space.dofmap.index_map.global_to_local(holder.nodes)
        place = np.full(scene.space.tabulate_dof_coordinates().shape[0], -1)
        place[local[local >= 0]] = np.flatnonzero(local >= 0)
        same = material_groups(scene) == holder.material
        cells = np.flatnonzero(same & (place[table] >= 0).any(axis=1)).astype(np.int32)
        at = place[table[cells]]  # which node of the probe's cell each node of a cell is
        inside = at >= 0
        volumes = self._points.evaluate(cells)[:, :, 13] @ self._points.weights
        shares = np.where(inside, volumes[:, None], 0.0)
        sums = np.zeros(holder.nodes.size)
        np.add.at(sums, at[inside], shares[inside])
        sums = np.asarray(scene.sum(sums))
        parts = np.where(inside, shares * (holder.weights / sums)[at], 0.0)
        return cells, parts @ extrapolation(scene, self._points)

    def _nodes_around(self) -> Bools:
        """Which owned nodes cells around probes have on any rank. Collective."""
        scene = self._scene
        marks = la.vector(scene.space.dofmap.index_map, 1)
        marks.array[:] = 0.0
        marks.array[scene.space.dofmap.list[self._cells].reshape(-1)] = 1.0
        marks.scatter_reverse(la.InsertMode.add)
        return np.asarray(marks.array[: scene.owned_nodes] > 0)

    def measure(self, state: State, strained: Strained | None = None) -> dict[str, StressAt]:
        """Stress and strain at each probe, by its name. Collective.

        Nodes inside bodies need not be up to date. `strained`, see `Recovery.recovered`, is called
        only where a probe is at a rigid cell.
        """
        u: fem.Function = self._points.u
        now = state.positions(self._nodes) - state.X[self._nodes]
        u.x.array.reshape(-1, 3)[self._nodes] = now
        u.x.scatter_forward()
        shaped = state.bodies.of.shapes is not None
        added = Added(*state.bent(self._wanted)) if shaped else None
        recovered = self._recovered(state, now, strained, added)
        self._points.recovered = recovered
        values = self._points.evaluate(self._cells)[:, :, :12]
        local = np.zeros((len(self._names), 13))
        np.add.at(local[:, :12], self._of, np.einsum("cq,cqi->ci", self._weights, values))
        if recovered is not None:
            np.add.at(local[:, 12], self._of, recovered.cells[self._cells])
        rows = np.asarray(self._scene.sum(local))
        return {
            name: StressAt(tensors(row[:6]), tensors(row[6:12]), bool(row[12] > 0))
            for name, row in zip(self._names, rows, strict=True)
        }

    def _recovered(
        self, state: State, now: Array, strained: Strained | None, added: Added | None
    ) -> Recovered | None:
        """Strains of cells in place of those of u, and further ones; None if none. Collective."""
        rigid = (state.body_numbers() > 0) & (strained is not None)
        instead = rigid if added is None else rigid & ~added.cells
        if strained is None or not self._scene.sum(float(instead[self._cells].sum())):
            return None if added is None else Recovered(self._more, rigid, instead, added)
        carried = strained()
        self._more.x.array.reshape(-1, 3)[self._nodes] = now + carried.u[self._nodes]
        self._more.x.scatter_forward()
        cells, linear = carried.among(rigid.size)
        return Recovered(self._more, cells if added is None else rigid, linear, added)


class Probes:
    """Displacements and stresses of named points; `points` has nodes of this rank and weights."""

    def __init__(self, scene: Scene) -> None:
        """Find the nodes of the cells that hold the points. Collective."""
        self._scene = scene
        self.points: dict[str, Point] = {}
        self._holders: dict[str, Holder] = {}
        groups = material_groups(scene)
        for name, (root, cell) in scene.probe_cells.items():
            mine = None
            if root == scene.comm.rank:
                weights = weights_at(scene, cell, scene.probes[name])
                mine = Holder(*weights, int(groups[cell]))
            self._holders[name] = found = scene.comm.bcast(mine, root=root)
            self.points[name] = owned_part(scene, found.nodes, found.weights)
        each = list(self.points.values())
        self._nodes = np.concatenate([np.empty(0, np.int64), *(p.nodes for p in each)])
        self._weights = block_diag(*(p.weights[None] for p in each))

    def displacements(self, state: State) -> Mapping[str, Array]:
        """Displacement of each point, shape (3,) [m]. Collective."""
        return self._summed(lambda nodes: state.positions(nodes) - state.X[nodes])

    def velocities(self, state: State) -> Mapping[str, Array]:
        """Velocity of each point, shape (3,) [m/s]. Collective."""
        return self._summed(state.velocities)

    def _summed(self, at: Callable[[Ints], Array]) -> Mapping[str, Array]:
        """Weighted sums of vectors at the nodes round each point. Collective."""
        if not self.points:
            return {}
        sums = self._scene.sum(self._weights @ at(self._nodes))
        return dict(zip(self.points, np.asarray(sums), strict=True))

    def stresses(self, state: State, strained: Strained | None = None) -> Mapping[str, StressAt]:
        """Stress and strain at each point: see `ProbeStress.measure`. Collective."""
        return self._stress.measure(state, strained) if self.points else {}

    @cached_property
    def _stress(self) -> ProbeStress:
        return ProbeStress(self._scene, self._holders)

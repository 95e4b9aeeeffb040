"""Stress and strain at nodes, extrapolated in each cell and averaged among those of a material.

Values at integration points are fitted by least squares, trilinear in hexahedra, linear in
second-order tetrahedra and constant in first-order ones (J. Barlow, IJNME 10 (1976) 243,
doi:10.1002/nme.1620100202), and read at the nodes of the cell. A node takes the mean of cells of
one material, weighted by reference volume; between materials it has a value for either side.
docs/notes/elements.md has errors of a cantilever. Where the exact stress is infinite, as at a
re-entrant corner or under a force on a node, the value grows as cells shrink.
"""

from functools import cached_property
from typing import Any

import basix
import numpy as np
from dolfinx import fem, la
from scipy.sparse import csr_array

from rigidfx.base.types import Array, Indices
from rigidfx.flexible.stress import PointStress, Recovered, chunks
from rigidfx.scene.scene import Scene


class NodalStress:
    """Measures stress and strain at all nodes, for each material that meets there.

    Attributes:
        points: Stress at integration points.
        groups: For each owned cell the number of its material, equal ones having one number.
    """

    def __init__(
        self, scene: Scene, points: PointStress | None = None, cells: Indices | None = None
    ) -> None:
        """Compile the expressions, if they are not given. Collective.

        Args:
            scene: The problem.
            points: Stress at the integration points of that scene.
            cells: Owned cells, in ascending order, if nodes are of interest only all of whose
                cells are among them, on all ranks; values at others mean nothing then.
        """
        self._scene = scene
        self.points = PointStress(scene) if points is None else points
        self.groups = material_groups(scene)
        every = np.arange(self.groups.size, dtype=np.int32)
        self._cells = every if cells is None else cells
        self._extrapolate = extrapolation(scene, self.points)

    def measure(self, u: fem.Function, recovered: Recovered | None = None) -> Array:
        """Stress [Pa] and strain of the local nodes, shape (materials, nodes, 12). Collective.

        Six components each, in the order xx, yy, zz, xy, yz, xz; zero where a node has no cell of a
        material.

        Args:
            u: Displacement, up to date inside bodies too: see `State.rebuild`.
            recovered: Strains of some cells in place of u, see `PointStress`.
        """
        self.points.take(u, recovered)
        corners, out = self._extrapolate.shape[0], np.zeros((self._shares.shape[0], 12))
        for at in chunks(self._cells.size):
            values = self._extrapolate @ self.points.evaluate(self._cells[at])[:, :, :12]
            own = slice(at[0] * corners, (at[-1] + 1) * corners)
            out += self._shares[:, own] @ values.reshape(-1, 12)
        sums = out.reshape(len(self._scene.materials), -1, 12)
        return np.stack([summed(self._scene, group) for group in sums])

    @cached_property
    def _shares(self) -> Any:
        """Share of each cell's nodes in the value of a node, rows being those of all materials."""
        nodes = self._scene.space.dofmap.list[self._cells]
        local = self._scene.space.tabulate_dof_coordinates().shape[0]
        volumes = [
            self.points.evaluate(self._cells[at])[:, :, 13] @ self.points.weights
            for at in chunks(self._cells.size)
        ]
        data = np.repeat(np.concatenate([np.empty(0), *volumes]), nodes.shape[1])
        groups = self.groups[self._cells].astype(np.int64)
        rows = (groups[:, None] * local + nodes).reshape(-1)
        shape = (len(self._scene.materials) * local, data.size)
        shares = csr_array((data, (rows, np.arange(data.size))), shape=shape)
        sums = np.asarray(shares.sum(axis=1)).reshape(-1, local)
        all_ranks = np.concatenate([summed(self._scene, group[:, None])[:, 0] for group in sums])
        shares.data /= np.repeat(all_ranks, np.diff(shares.indptr))
        return shares


def extrapolation(scene: Scene, points: PointStress) -> Array:
    """The matrix from values at a cell's integration points to its nodes, shape (nodes, points)."""
    element: Any = scene.space.element
    nodes, weights = element.basix_element.points, points.weights
    if scene.simplex and scene.order == 1:
        return np.tile(weights / weights.sum(), (len(nodes), 1))
    cell = getattr(basix.CellType, scene.mesh.topology.cell_name())
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    at_points, at_nodes = (linear.tabulate(0, x)[0, :, :, 0] for x in (points.points, nodes))
    weighted = at_points.T * weights
    return np.asarray(at_nodes @ np.linalg.solve(weighted @ at_points, weighted))


def summed(scene: Scene, values: Array) -> Array:
    """Sums over ranks of values of local nodes, ghosts included, shape (nodes, n). Collective."""
    vector = la.vector(scene.space.dofmap.index_map, values.shape[1])
    vector.array[:] = values.reshape(-1)
    vector.scatter_reverse(la.InsertMode.add)
    vector.scatter_forward()
    return np.array(vector.array).reshape(values.shape)


def material_groups(scene: Scene) -> Indices:
    """For each owned cell the number of the first of the scene's materials that equals its own."""
    groups = np.zeros(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    materials = [material for material, _ in scene.materials]
    for material, cells in scene.materials:
        groups[cells] = materials.index(material)
    return groups

"""Fields at integration points for ParaView: a cloud of points, neither extrapolated nor averaged.

They are `displacement` [m], Cauchy stress `stress` (nine components), `von_mises` of it [Pa] and
Green-Lagrange strain `strain`, as `rigidfx.flexible.stress` defines them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rigidfx.base.types import Array
from rigidfx.flexible.stress import PointStress, chunks, tensors, von_mises
from rigidfx.output.paraview import Body, Cloud
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["PointFields"]


class PointFields:
    """Brings the fields at integration points to rank 0.

    Attributes:
        body: The points, in the order of the mesh file's cells.
    """

    def __init__(self, scene: Scene) -> None:
        """Compile what they need, and place the points. Collective.

        Args:
            scene: The problem that is run.
        """
        self._points = PointStress(scene)
        self._owned = int(scene.mesh.topology.index_map(3).size_local)
        self._nodes = scene.space.dofmap.list[: self._owned]
        element: Any = scene.space.element
        self._shapes = element.basix_element.tabulate(0, self._points.points)[0, :, :, 0]
        self._cells = Body(scene.space)
        X = self._on_points(self._shapes @ scene.space.tabulate_dof_coordinates()[self._nodes])
        self.body = Cloud(X, np.arange(len(X), dtype=np.int32)[:, None])

    def _on_points(self, values: Array) -> Array:
        """Values of shape (cells, points, …) on rank 0, a row for each point. Collective."""
        return self._cells.on_cells(values).reshape(-1, *values.shape[2:])

    def values(self, report: Report) -> dict[str, Array]:
        """Fields at the points, whole on rank 0. Collective."""
        state = report.state
        state.rebuild()
        self._points.take(state.u, report.strains())
        u = report.shown()[0].x.array
        out = np.empty((self._owned, self._points.weights.size, 12))
        for cells in chunks(self._owned):
            out[cells] = self._points.evaluate(cells)[:, :, :12]
        rows = self._on_points(out)
        stress = tensors(rows[:, :6])
        return {
            "displacement": self._on_points(self._shapes @ u.reshape(-1, 3)[self._nodes]),
            "stress": stress,
            "von_mises": von_mises(stress),
            "strain": tensors(rows[:, 6:]),
        }

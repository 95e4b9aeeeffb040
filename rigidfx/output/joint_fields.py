"""Clouds of points for ParaView: joints, and integration points.

A joint is a point with its force and moment for arrows. Fields of joints are `displacement` of the
joint's place [m], `force` [N] and `moment` [N m] on its second side, `angle` [rad] and `travel`
[m], zero where a joint leaves none free, and `gap` [m].

Fields at integration points are neither extrapolated nor averaged: `displacement` [m], Cauchy
stress `stress` (nine components), `von_mises` of it [Pa] and Green-Lagrange strain `strain`, as
`rigidfx.flexible.stress` defines them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rigidfx.base.types import Array
from rigidfx.effects import Joint, JointReport
from rigidfx.flexible.stress import PointStress, chunks, tensors, von_mises
from rigidfx.output.paraview import Body, Cloud
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["JointFields", "clouds_of"]


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


class JointFields:
    """Values of joints, in the order of the scene.

    Attributes:
        body: The places of the joints at the start.
    """

    def __init__(self, scene: Scene) -> None:
        """Keep their places.

        Args:
            scene: The problem that is run.
        """
        joints = scene.named(Joint)
        self._titles = [joint.title for joint in joints]
        at = np.array([joint.at for joint in joints], dtype=np.float64)
        self.body = Cloud(at, np.arange(len(at), dtype=np.int32)[:, None])

    def values(self, report: Report) -> dict[str, Array]:
        """Values at a report; zero before the first step."""
        told = [report.joints[title] for title in self._titles] if report.joints else []

        def each(of: Callable[[JointReport], float | Array], *shape: int) -> Array:
            if not told:
                return np.zeros((len(self._titles), *shape))
            return np.nan_to_num(np.array([of(joint) for joint in told], dtype=np.float64))

        places = each(lambda joint: joint.place, 3) if told else self.body.points
        return {
            "displacement": places - self.body.points,
            "force": each(lambda joint: joint.force, 3),
            "moment": each(lambda joint: joint.moment, 3),
            "angle": each(lambda joint: joint.angle),
            "travel": each(lambda joint: joint.travel),
            "gap": each(lambda joint: joint.gap),
        }


def clouds_of(scene: Scene, integration_points: bool) -> dict[str, PointFields | JointFields]:
    """The clouds of points of a run, by the names of their files. Collective.

    Args:
        scene: The problem.
        integration_points: Whether fields at these are wanted.
    """
    out: dict[str, PointFields | JointFields] = {}
    if integration_points:
        out["points"] = PointFields(scene)
    if scene.named(Joint):
        out["joints"] = JointFields(scene)
    return out

"""The fields of a run for ParaView, and clouds of points: joints, and integration points.

docs/columns.md lists them. Where materials meet, the series has a node for each of them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.types import Array, Indices
from rigidfx.effects import Contact, Joint, JointReport, PointMass
from rigidfx.flexible.nodal_stress import NodalStress, material_groups
from rigidfx.flexible.stress import CauchyStress, PointStress, chunks, tensors, von_mises
from rigidfx.output.paraview import Body, Cloud
from rigidfx.report.report import Report, recovered_stress
from rigidfx.scene.scene import Scene
from rigidfx.state import State

Values = dict[str, npt.NDArray[Any]]


class PointFields:
    """Brings the fields at integration points to rank 0.

    Attributes:
        body: The points, in the order of the mesh file's cells.
    """

    def __init__(self, scene: Scene) -> None:
        """Compile what they need, and place the points. Collective."""
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
        self._titles = [joint.title for joint in scene.named(Joint)]
        at = np.array([joint.at for joint in scene.named(Joint)], dtype=np.float64)
        self.body = Cloud(at, np.arange(len(at), dtype=np.int32)[:, None])

    def values(self, report: Report) -> dict[str, Array]:
        """Values at a report; zero before the first step."""

        def each(of: Callable[[JointReport], float | Array], *shape: int) -> Array:
            if not report.joints:
                return np.zeros((len(self._titles), *shape))
            values = [of(report.joints[title]) for title in self._titles]
            return np.nan_to_num(np.array(values, dtype=np.float64))

        places = each(lambda joint: joint.place, 3) if report.joints else self.body.points
        return {
            "displacement": places - self.body.points,
            "force": each(lambda joint: joint.force, 3),
            "moment": each(lambda joint: joint.moment, 3),
            "angle": each(lambda joint: joint.angle),
            "travel": each(lambda joint: joint.travel),
            "gap": each(lambda joint: joint.gap),
        }


def clouds_of(scene: Scene, integration_points: bool) -> dict[str, PointFields | JointFields]:
    """The clouds of points of a run, by the names of their files. Collective."""
    points = {"points": PointFields(scene)} if integration_points else {}
    return points | ({"joints": JointFields(scene)} if scene.named(Joint) else {})


class Fields:
    """Brings the fields of a scene to rank 0.

    Attributes:
        body: Points and cells.
    """

    def __init__(self, scene: Scene, stress: bool) -> None:
        """Number cells and nodes; without stresses none is computed or compiled. Collective."""
        self.body = Body(scene.space, material_groups(scene) if stress else None)
        self._materials = self.body.on_cells(_material_numbers(scene))
        self._nodal = NodalStress(scene) if stress else None
        self._mean = CauchyStress(scene, self._nodal.points) if self._nodal else None
        self._scene, self._contacts = scene, scene.named(Contact)
        masses = any(effect.is_carried for effect in scene.named(PointMass))
        self._may_be_rigid = masses or any(effect.is_body for effect in scene.effects)

    def may_have_bodies(self, report: Report) -> bool:
        """Whether there are rigid bodies in a run, or may be."""
        return self._may_be_rigid or report.finds_bodies

    def on_nodes(self, report: Report) -> Values:
        """Fields on the nodes, whole on rank 0. Collective."""
        state = report.state
        state.rebuild()
        u, v = report.shown()
        fields: Values = {"displacement": self.body.on_nodes(u), "velocity": self.body.on_nodes(v)}
        if self._nodal is not None:
            values = self.body.on_nodes_of_parts(self._nodal.measure(state.u, report.strains()))
            stress = tensors(values[:, :6])
            fields |= {"stress": stress, "von_mises": von_mises(stress)}
            fields["strain"] = tensors(values[:, 6:])
        if self._contacts:
            fields |= self._of_contacts(state)
        return fields

    def _of_contacts(self, state: State) -> Values:
        """Pressure of contacts [Pa] and the least gap [m], NaN off their surfaces. Collective."""
        x = state.X + state.u.x.array.reshape(-1, 3)
        pressure, gap = np.full((2, len(x)), np.nan)
        for contact in self._contacts:
            on, own_gap, own_pressure = contact.at_nodes(self._scene, x, state.t)
            gap[on] = np.fmin(gap[on], own_gap)
            pressure[on] = np.nan_to_num(pressure[on]) + own_pressure
        values = {"contact_pressure": pressure, "gap": gap}
        return {name: self.body.on_nodes(array) for name, array in values.items()}

    def on_cells(self, report: Report) -> Values:
        """Fields on the cells, whole on rank 0. Collective."""
        state = report.state
        state.rebuild()
        fields: Values = {"material": self._materials}
        if self._mean is not None:
            measured, recovered = recovered_stress(report, self._mean)
            stress = self.body.on_cells(measured)
            fields |= {"cell_stress": stress, "cell_von_mises": von_mises(stress)}
            if report.recovers:
                fields["recovered"] = self.body.on_cells(recovered.astype(np.uint8))
        if self.may_have_bodies(report):
            level = self.body.on_cells(state.levels)
            fields |= {"level": level, "rigid": (level == 2).astype(np.uint8)}
            fields["body"] = self.body.on_cells(state.body_numbers())
        if report.strain_rate is not None:
            fields["strain_rate"] = self.body.on_cells(report.strain_rate)
        return fields


def _material_numbers(scene: Scene) -> Indices:
    """For each owned cell, which of the scene's materials it has, counted from 0."""
    numbers = np.zeros(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    for k, (_, cells) in enumerate(scene.materials):
        numbers[cells] = k
    return numbers

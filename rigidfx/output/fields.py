"""The fields of a run for ParaView.

They are displacement [m] and velocity [m/s] on the nodes; where a run follows its error motion both
contain it, and it is there by itself as `error_motion` [m]. On the nodes are also Cauchy stress
`stress` (nine components), `von_mises` of it [Pa] and Green-Lagrange strain `strain`, extrapolated
and averaged among the cells of a material (`rigidfx.flexible.nodal_stress`): where materials meet,
the series has a node for each. In scenes with contacts their pressure [Pa] and gap [m] are there
too (NaN off their surfaces). On the cells there are the means `cell_stress` and `cell_von_mises`
[Pa] (`rigidfx.flexible.stress`), the number of the material, and, where there are bodies or may be,
the number of the body (0 outside bodies), the `level` (0 flexible, 1 reduced, 2 rigid), a flag
`rigid` and, where parts are found, the strain rate of the step [1/s], zero in bodies. With
`wake="local"` stress and strain of a rigid cell, in its mean and in its share of the values at its
nodes, are those of its freeze and what the forces on it add, were it flexible: `recovered` is 1
there, see `rigidfx.report.recovered`.
Where a run follows its error motion stress and strain of all cells contain its part.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.base.types import Indices
from rigidfx.effects import Contact, PointMass
from rigidfx.flexible.nodal_stress import NodalStress, material_groups
from rigidfx.flexible.stress import CauchyStress, tensors, von_mises
from rigidfx.output.paraview import Body
from rigidfx.report.recovered import recovered_stress
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.state import State

__all__ = ["Fields"]

Values = dict[str, npt.NDArray[Any]]


class Fields:
    """Brings the fields of a scene to rank 0.

    Attributes:
        body: Points and cells.
    """

    def __init__(self, scene: Scene, stress: bool) -> None:
        """Number cells and nodes. Collective.

        Args:
            scene: The problem that is run.
            stress: Whether stresses are among the fields. If not, none is computed or compiled.
        """
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
        fields = self._motion(report)
        if self._nodal is not None:
            values = self.body.on_nodes_of_parts(self._nodal.measure(state.u, report.strains()))
            stress = tensors(values[:, :6])
            fields |= {"stress": stress, "von_mises": von_mises(stress)}
            fields["strain"] = tensors(values[:, 6:])
        if self._contacts:
            fields |= self._of_contacts(state)
        return fields

    def _motion(self, report: Report) -> Values:
        """Displacement and velocity with the error motion, and that alone. Collective."""
        u, v, e = report.shown()
        fields = {"displacement": u, "velocity": v} | ({} if e is None else {"error_motion": e})
        return {name: self.body.on_nodes(field) for name, field in fields.items()}

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

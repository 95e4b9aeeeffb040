"""The fields of a run for ParaView.

They are displacement [m] and velocity [m/s] on the nodes, and on the cells the Cauchy stress
(nine components) and von Mises' [Pa], both as `stress` defines them, the number of the material,
and, where there are rigid bodies or may be, the number of the body (0 outside bodies), a flag
(1 rigid, 0 flexible) and, where parts are found, the strain rate of the step [1/s], zero in bodies.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.effects import Rigid
from rigidfx.flexible.stress import CauchyStress, von_mises
from rigidfx.output.paraview import Body
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

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
        self.body = Body(scene.space)
        self._materials = self.body.on_cells(_material_numbers(scene))
        self._stress = CauchyStress(scene) if stress else None
        self._may_be_rigid = bool(scene.named(Rigid))

    def may_have_bodies(self, report: Report) -> bool:
        """Whether there are rigid bodies in a run, or may be."""
        return self._may_be_rigid or report.finds_bodies

    def on_nodes(self, report: Report) -> Values:
        """Fields on the nodes, whole on rank 0. Collective."""
        state = report.state
        state.rebuild()
        return {f.name: self.body.on_nodes(f) for f in (state.u, state.v)}

    def on_cells(self, report: Report) -> Values:
        """Fields on the cells, whole on rank 0. Collective."""
        state = report.state
        state.rebuild()
        fields: Values = {"material": self._materials}
        if self._stress is not None:
            stress = self.body.on_cells(self._stress.measure(state.u))
            fields |= {"stress": stress, "von_mises": von_mises(stress)}
        if self.may_have_bodies(report):
            numbers = self.body.on_cells(state.body_numbers())
            fields |= {"body": numbers, "rigid": (numbers > 0).astype(np.uint8)}
        if report.strain_rate is not None:
            fields["strain_rate"] = self.body.on_cells(report.strain_rate)
        return fields


def _material_numbers(scene: Scene) -> npt.NDArray[np.int32]:
    """For each owned cell, which of the scene's materials it has, counted from 0."""
    numbers = np.zeros(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    for k, (_, cells) in enumerate(scene.materials):
        numbers[cells] = k
    return numbers

"""Does anything act in a run? Else nothing moves, and no number tells why."""

from __future__ import annotations

from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.report.jolts import NEGLIGIBLE
from rigidfx.report.look import Look
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["Stillness"]


class Stillness(Look):
    """Looks for energies, work and reactions; warns at the end where there are none."""

    remembered: ClassVar[Remembered] = same("_still")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report. Collective.

        Args:
            scene: The problem.
        """
        self._comm, self._still, self._t = scene.comm, True, 0.0
        mass = scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())
        way = NEGLIGIBLE * scene.mean_cell_size
        self._impulse, self._floor = mass * way, 0.5 * mass * way**2  # [N s²], [J s²]

    def follow(self, report: Report) -> None:
        """Look at a report.

        Args:
            report: The next one.
        """
        self._t = report.t
        per_step = 1 / report.dt**2 if report.dt else 0.0  # joints at rest move by rounding
        works = report.energy, abs(report.work_of_loads), abs(report.work_of_supports)
        held = any(force.any() for force in report.reactions.values())
        held |= report.joints.total > self._impulse * per_step
        self._still &= not (max(works) > self._floor * per_step or held)

    def end(self) -> None:
        """Warn if nothing has moved."""
        if self._still:
            warn(
                self._comm,
                f"Up to t = {self._t:.6g} s nothing acts and nothing moves: the scene has neither "
                "a load, nor a motion that is prescribed, nor a velocity or displacement at the "
                "start. Scene.describe() tells which effects act when.",
            )

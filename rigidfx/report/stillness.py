"""Does anything act in a run? Else nothing moves, and no number tells why.

Does a support, or a contact, that begins give or take much of the energy at one instant?

A motion that is prescribed at full speed from t = 0 on under a body at rest is an impact: the held
nodes have their velocity at once, and waves run from them through the body. Its size is the larger
one of the energy of the impact, and of that with which the body would follow the support at once.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.report.report import Look, Report
from rigidfx.scene.scene import Scene
from rigidfx.step.system.supports import Impact

__all__ = ["Jolts", "Stillness"]

GOOD_PART = 0.1  # of the energy before or after an impact, whichever is larger
# Of the largest energy up to the end of the next step, and of a cell in a step. A path that starts
# smoothly has a velocity by a difference quotient, whose error is 1e-6 of that after a step; its
# square is 1e-12. Where the path rests, rounding leaves 1e-12 of its place in a step.
NEGLIGIBLE = 1e-9


class Jolts(Look):
    """Looks at the impacts of reports; warns once."""

    remembered: ClassVar[Remembered] = same("_waits", "_energy", "_most", "_found")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report. Collective.

        Args:
            scene: The problem.
        """
        self._comm, self._waits = scene.comm, True
        mass = scene.sum(scene.nodal_mass[: scene.owned_nodes].sum())
        self._floor = 0.5 * mass * (NEGLIGIBLE * scene.mean_cell_size) ** 2  # [J s²]
        self._energy: float | None = None  # at the end of the last step [J]
        self._most = 0.0  # the largest so far [J]
        self._found: tuple[Impact, float] | None = None  # in the last report, and its part

    def follow(self, report: Report) -> None:
        """Look at a report.

        Args:
            report: The next one.
        """
        if not self._waits:
            return
        impact, before = report.impact, self._energy
        self._energy, self._most = report.energy, max(self._most, report.energy)
        if self._found is not None:
            least = max(NEGLIGIBLE * self._most, self._floor / report.dt**2)
            if abs(self._found[0].energy) > least:
                self._say(*self._found)
                return
            self._found = None
        if impact is None:
            return
        if before is None:
            before = report.energy - impact.energy
        size = max(abs(impact.energy), impact.following)
        part = min(size / max(before, before + impact.energy, np.finfo(float).tiny), 1.0)
        if part > GOOD_PART:
            self._found = impact, part

    def _say(self, impact: Impact, part: float) -> None:
        """Warn, and look no more."""
        self._waits = False
        names = ", ".join(f"'{name}'" for name in impact.supports)
        gives = "brings" if impact.energy > 0 else "takes"
        share, follows = f", {part:.0%} of the energy", ""
        if impact.following > abs(impact.energy):
            follows = f" To follow at once, all that it holds would take {impact.following:.3g} J"
            share, follows = "", f"{follows}{share}."
        warn(
            self._comm,
            f"At t = {impact.t:.6g} s {names} acts with a jolt: an impact {gives} "
            f"{abs(impact.energy):.3g} J{share} at one instant, and waves run from there.{follows} "
            "If no blow is meant, let a prescribed motion start from the velocity that the nodes "
            "have and grow over some periods of vibration (rf.Table, or a smooth path), give the "
            "whole body the motion of the support by InitialVelocity, or let a contact begin where "
            "nothing overlaps. The report has the impact in `impact`.",
        )


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

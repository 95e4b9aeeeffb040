"""Does a support, or a contact, that begins give or take much of the energy at one instant?

A motion that is prescribed at full speed from t = 0 on under a body at rest is an impact: the held
nodes have their velocity at once, and waves run from them through the body.
"""

from __future__ import annotations

from rigidfx.base.warning import warn
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["Jolts"]

GOOD_PART = 0.1  # of the energy before or after an impact, whichever is larger


class Jolts:
    """Looks at the impacts of reports; warns once."""

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
        """
        self._comm, self._waits = scene.comm, True
        self._energy: float | None = None  # at the end of the last step [J]

    def follow(self, report: Report) -> None:
        """Look at a report.

        Args:
            report: The next one.
        """
        impact, before = report.impact, self._energy
        self._energy = report.energy
        if impact is None or not self._waits:
            return
        if before is None:
            before = report.energy - impact.energy
        largest = max(before, before + impact.energy)
        if abs(impact.energy) <= GOOD_PART * largest:
            return
        self._waits = False
        names = ", ".join(f"'{name}'" for name in impact.supports)
        gives = "brings" if impact.energy > 0 else "takes"
        warn(
            self._comm,
            f"At t = {impact.t:.6g} s {names} acts with a jolt: an impact {gives} "
            f"{abs(impact.energy):.3g} J, {abs(impact.energy) / largest:.0%} of the energy, at one "
            "instant, and waves run from there. If no blow is meant, let the prescribed motion "
            "start from the velocity that the nodes have and grow over some periods of vibration "
            "(rf.Table, or a smooth path), or give the whole body the motion of the support by "
            "InitialVelocity. The report has the impact in `impact`.",
        )

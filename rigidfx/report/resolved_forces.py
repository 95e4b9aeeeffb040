"""The forces of contacts, averaged over the shortest time that a mesh resolves.

A contact's force in a step is its impulse over Δt, which is exact. In short steps it is a force
between nodes: those of a flat face that hits a floor ring on the penalty by their own mass, with
twice the force ρ c v A of the body at any size of cells. Its mean over a few crossings of the
layer of cells behind, weighted by a triangle, converges to that of the body with smaller cells.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from rigidfx.base.named import Named
from rigidfx.base.remembered import Remembered, same
from rigidfx.effects import Contact
from rigidfx.effects.contacts.layer_times import resolved_time
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["ResolvedForces", "trailing_mean"]

Steps = list[tuple[float, float]]  # length [s] and force [N] of the last steps


class ResolvedForces:
    """Adds `Touch.resolved` to reports."""

    remembered: ClassVar[Remembered] = same("_steps")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
        """
        self._scene = scene
        self._times: dict[str, float] = {}  # that the mesh resolves, once a contact has closed [s]
        self._steps: dict[str, Steps] = {}  # of contacts that press, or have just pressed

    def of(self, report: Report) -> Report:
        """A report with resolved forces. Collective.

        Args:
            report: The next one.
        """
        found = {}
        for contact in self._scene.named(Contact):
            touch = report.touches.get(contact.title)
            steps = self._steps.setdefault(contact.title, [])
            if touch is None:
                steps.clear()
            if touch is None or not (steps or touch.pressing > 0):
                continue
            if contact.title not in self._times:
                self._times[contact.title] = resolved_time(self._scene, contact)
            steps.append((report.dt, touch.pressing))
            resolved = trailing_mean(steps, self._times[contact.title])
            found[contact.title] = replace(touch, resolved=resolved)
        if not found:
            return report
        return replace(report, touches=Named("report.touches", {**report.touches, **found}))


def trailing_mean(steps: Steps, time: float) -> float:
    """Mean force over the last time, weighted by a triangle; that of the last step if it is longer.

    Args:
        steps: Those since then, and earlier ones, which are removed.
        time: Length of the mean [s].

    Returns:
        The force [N].
    """
    lengths, forces = np.array(steps[::-1]).T
    ages = np.concatenate([[0.0], np.cumsum(lengths)])  # of the ends of steps, the last one first
    if lengths[0] >= time:
        steps.clear()
        return float(forces[0])
    x = np.minimum(ages / time, 1.0)
    weights = np.diff(np.where(x < 0.5, 2.0 * x**2, 1.0 - 2.0 * (1.0 - x) ** 2))
    mean = float(weights @ forces)
    del steps[: np.count_nonzero(ages[:-1] >= time)]
    if not any(force for _, force in steps):
        steps.clear()
    return mean

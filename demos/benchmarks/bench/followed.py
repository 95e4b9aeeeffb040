"""A run of a mechanism in numbers."""

from collections.abc import Callable
from statistics import mean, median
from typing import Any

import numpy as np
import numpy.typing as npt
from common import Balance

import rigidfx as rf

Array = npt.NDArray[np.float64]


class Followed:
    """A run that is over.

    Attributes:
        drift: Largest error of its balance of energy [J].
        gap: Largest violation of a joint [m].
        seconds: Median wall time of a step [s].
        iterations: Mean Newton iterations of a step.
        seen: What was looked at in each report, that of the initial state first.
        last: Its last report.
    """

    def __init__(
        self,
        scene: rf.Scene,
        dt: float,
        t_end: float,
        look: Callable[[rf.Report], Any] = lambda report: None,
    ) -> None:
        """Run a scene."""
        balance, wall, iterations, self.gap, self.seen = Balance(), [], [], 0.0, []
        for report in rf.simulate(scene, dt, t_end, progress=False):
            balance.follow(report)
            self.seen.append(look(report))
            if report.step:
                self.gap = max(self.gap, *(joint.gap for joint in report.joints.values()))
                wall.append(report.wall)
                iterations.append(report.iterations)
        self.drift, self.last = balance.off, report
        self.seconds, self.iterations = median(wall), mean(iterations)

    def place(self, name: str, arm: Array) -> Array:
        """Where a point of a rigid part is at the end, by its place in the part's frame [m]."""
        [motion] = [body.motion for body in self.last.rigid if body.data.name == name]
        return motion.r + motion.R @ arm

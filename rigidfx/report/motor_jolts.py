"""Does a motor start at a speed that its joint does not have?

A prescribed speed or path is the mean over a step. Where the joint turns more slowly before, the
motor brings its speed in the first step and throws the velocities as far beyond; its effort then
changes sign from step to step.
"""

from __future__ import annotations

from typing import ClassVar

from rigidfx.base.remembered import Remembered, same
from rigidfx.base.warning import warn
from rigidfx.effects import Motor
from rigidfx.report.jolts import GOOD_PART
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["MotorJolts"]


class MotorJolts:
    """Looks at the efforts of motors that prescribe a motion; warns once of each."""

    remembered: ClassVar[Remembered] = same("_first", "_done")

    def __init__(self, scene: Scene) -> None:
        """Begin before the first report.

        Args:
            scene: The problem.
        """
        self._comm = scene.comm
        self._motors = [motor for motor in scene.named(Motor) if motor.prescribes]
        self._first: dict[str, float] = {}  # effort in the first step of a motor
        self._done: list[str] = []  # motors that have been looked at

    def follow(self, report: Report) -> None:
        """Look at a report.

        Args:
            report: The next one.
        """
        if not report.step or len(self._done) == len(self._motors):
            return
        for motor in self._motors:
            joint, name = report.joints[motor.joint], motor.owner
            if name in self._done or name not in joint.efforts:
                continue
            rate = joint.angle_rate if motor.coordinate == "angle" else joint.travel_rate
            effort = joint.efforts[name]
            good = abs(effort * rate * report.dt) > GOOD_PART * report.energy
            if good and name not in self._first:
                self._first[name] = effort
                continue
            self._done.append(name)
            first = self._first.get(name, 0.0)
            if good and effort * first < 0:
                warn(
                    self._comm,
                    f"{name} acts with a jolt before t = {report.t:.6g} s: it brings its speed in "
                    f"one step, with an effort of {first:.3g}, and takes it back by {effort:.3g} "
                    "in the next. Let the speed grow from that of the joint over some periods of "
                    "vibration (rf.Table, or a smooth function), or give all that it moves this "
                    "motion by InitialVelocity.",
                )

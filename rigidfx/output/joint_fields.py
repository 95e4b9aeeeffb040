"""Joints for ParaView: a point at each, with its force and moment for arrows.

They are `displacement` of the joint's place [m], `force` [N] and `moment` [N m] on its second side,
`angle` [rad] and `travel` [m], zero where a joint leaves none free, and `gap` [m].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rigidfx.base.types import Array
from rigidfx.effects import Joint, JointReport
from rigidfx.output.paraview import Cloud
from rigidfx.output.point_fields import PointFields
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene

__all__ = ["JointFields", "clouds_of"]


class JointFields:
    """Values of joints, in the order of the scene.

    Attributes:
        body: The places of the joints at the start.
    """

    def __init__(self, scene: Scene) -> None:
        """Take their places.

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

"""Force and motion of a joint in a step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

__all__ = ["JointReport"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class JointReport:
    """Force and motion of a joint in a step; forces are those at its midpoint, in space.

    Attributes:
        place: Place of the joint on its first side at the end of the step, shape (3,) [m].
        force: On its second side, of rows, motors and springs together, shape (3,) [N].
        moment: On its second side about the joint's place, likewise [N m].
        angle: Of the second side about the axis, turns counted [rad]; NaN if it leaves none free.
        travel: Of the second side along the axis [m]; NaN if it leaves none free.
        angle_rate: Mean rate of the angle in the step [rad/s]; NaN likewise.
        travel_rate: Mean rate of the travel [m/s]; NaN likewise.
        efforts: Torque [N m] or force [N] of each motor, spring and stop of the joint that acts, by
            its owner, such as "Motor of 'pin'". Of two with one owner in the scene each has more:
            "Motor of 'pin', torque 2".
        gap: Largest violation of its rows at the end of the step [m].
    """

    place: Array
    force: Array
    moment: Array
    angle: float = np.nan
    travel: float = np.nan
    angle_rate: float = np.nan
    travel_rate: float = np.nan
    efforts: Mapping[str, float] = field(default_factory=dict)
    gap: float = 0.0

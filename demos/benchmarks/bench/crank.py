"""The joints of the slider-crank of demos/mechanism.py, its motor and its stop."""

from __future__ import annotations

from collections.abc import Callable

import rigidfx as rf
from meshes.mechanism import LENGTH, RADIUS

__all__ = ["BLOCK", "driven"]

BLOCK = RADIUS + LENGTH + 0.069, 0.0, 0.03  # m; a corner of the block


def driven(speed: Callable[[float], float]) -> list[rf.Effect]:
    """Joints at mean faces, a motor by speed [rad/s], a stop before the dead centre, damping."""
    face, z, wrist = rf.MeanFace, (0.0, 0.0, 1.0), (RADIUS + LENGTH, 0.0, 0.0)
    return [
        rf.Revolute("ground", face("journals"), (0, 0, 0), z, name="bearing"),
        rf.Cylindrical(face("pin"), face("big eye"), (RADIUS, 0, 0), z, name="crank pin"),
        rf.Spherical(face("small eye"), face("wrist"), wrist, name="wrist pin"),
        rf.Prismatic("ground", face("slides"), wrist, (1, 0, 0), name="guide"),
        rf.Motor("bearing", speed=speed),
        rf.Stop("guide", low=-2 * RADIUS + 5e-4, stiffness=2e7),  # N/m
        rf.NumericalDamping(0.1),
    ]

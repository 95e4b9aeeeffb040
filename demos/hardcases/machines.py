"""Machines whose parts bend: results that must not depend on how a joint takes hold of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import rigidfx as rf

from .case import History, Run, case, near

LENGTH, AXIAL, BENDING, LINE = 10.0, 2.8e7, 1.4e4, 1.2  # m, N, N m², kg/m
SPUN, SPEED = 15.0, 6.0  # s, rad/s
LAG, SWING = 0.5763, 0.005  # m


def _turned(t: float) -> float:
    """The angle of the hub [rad]."""
    if t > SPUN:
        return SPEED * (t - SPUN / 2)
    w = 2 * np.pi / SPUN
    return float(SPEED / SPUN * (t * t / 2 + (np.cos(w * t) - 1) / w**2))


def _arm(way: str) -> rf.Scene:
    """The arm of Simo and Vu-Quoc, J. Appl. Mech. 53 (1986) 855, of square section."""
    thick = np.sqrt(12 * BENDING / AXIAL)
    b, face = thick / 2, rf.MeanFace("x0")
    box = rf.box((0, -b, -b), (LENGTH, b, b), (12, 1, 1))
    soft = rf.StVenantKirchhoff(E=AXIAL / thick**2, nu=0.0, rho=LINE / thick**2)
    hub = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    if way == "a support":
        held = [rf.PrescribedRotation("x0", axis=hub[1], through=hub[0], angle=_turned)]
    elif way == "sides exchanged":
        held = [rf.Revolute(face, "ground", *hub, name="hub")]
        held += [rf.Motor("hub", angle=lambda t: -_turned(t))]
    else:
        side = rf.RigidFace("x0") if way == "a rigid face" else face
        held = [rf.Revolute("ground", side, *hub, name="hub"), rf.Motor("hub", angle=_turned)]
    return rf.Scene(box, soft, held, order=2, probes={"tip": (LENGTH, 0, 0)})


def _lag(history: History) -> str:
    """Whether the end lags and then swings as it should."""
    t, angle = np.array(history.t), np.array([_turned(t) for t in history.t])
    x, y, _ = np.array(history.probes["tip"]).T
    behind = (x + LENGTH) * np.sin(angle) - y * np.cos(angle)
    swing = np.abs(behind[t >= SPUN]).max(initial=0.0)
    told = near("the largest lag", behind.max(), LAG, 1e-3)
    return told or ("" if swing <= SWING else f"it swings by {swing:.2g} m")


@case("machines", "a soft arm that a motor on a flat face brings to 6 rad/s in 15 s")
def spun_up_arm(short: bool) -> Iterator[Run]:
    """Its end lags by 0.576 m at most, then swings by 0.005 m, however it is held.

    It lagged by 0.76 m and swung by 0.24 m where the face was the second side of its hinge.
    """
    ways = "a mean face", "sides exchanged", "a rigid face", "a support"
    for way in ways[: 2 if short else None]:
        yield Run(
            way, _arm(way), 0.05, 8.0 if short else 20.0, momentum=None, tangents=12, check=_lag
        )

"""The beam that is spun up (J. C. Simo and L. Vu-Quoc, ASME J. Appl. Mech. 53 (1986) 855).

Its length is 10 m, EA 2.8e7 N, EI 1.4e4 N m², ρA 1.2 kg/m: a square solid of 77.5 mm. It is brought
to 6 rad/s in 15 s, by a support, or by a motor on its face: a mean one, with both orders of sides,
or a rigid one. The tip lags by 0.576 m, and afterwards the beam is stretched by
ρA ω² L³/(3 EA) = 5.14e-4 m, and swings by 5 mm at most. A step of φ stretches it by φ²/6 more.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import rigidfx as rf

from .row import Found, Problem

__all__ = ["SPIN_UP"]

LENGTH, SIDE = 10.0, 0.0775  # m
PLASTIC = rf.StVenantKirchhoff(E=4.67e9, nu=0.0, rho=200.0)
RATE, UP = 6.0, 15.0  # rad/s, s
LAG, STRETCH, SWING = 0.576, 5.14e-4, 0.005  # m
END, DT = 17.0, 0.025  # s
SHORT_END, SHORT_DT = 7.0, 0.07  # s: the largest lag is at 6.8 s
WAYS = "support", "motor, mean face", "motor, mean face second side", "motor, rigid face"


def angle(t: float) -> float:
    """Angle of the hub [rad]."""
    if t >= UP:
        return RATE * t - 45.0
    return RATE / UP * (t**2 / 2 + (UP / (2 * np.pi)) ** 2 * (np.cos(2 * np.pi * t / UP) - 1))


def speed(t: float) -> float:
    """Its derivative [rad/s]."""
    return RATE * min(t, UP) / UP - RATE / (2 * np.pi) * float(np.sin(2 * np.pi * min(t, UP) / UP))


def driven(way: str) -> list[rf.Effect]:
    """A way to turn the beam."""
    axis = 0.0, 0.0, 1.0
    if way == "support":
        return [rf.PrescribedRotation("x0", axis=axis, angle=angle, speed=speed)]
    face = rf.RigidFace("x0") if "rigid" in way else rf.MeanFace("x0")
    sides = (face, "ground") if "second" not in way else ("ground", face)
    sign = 1.0 if sides[0] == "ground" else -1.0
    hinge = rf.Revolute(*sides, (0, 0, 0), axis, name="hub")
    return [hinge, rf.Motor("hub", angle=lambda t: sign * angle(t))]


def spun(way: str, short: bool) -> list[Found]:
    """Largest lag of the tip, and in full runs the mean stretch afterwards."""
    y = SIDE / 2
    domain = rf.box((0, -y, -y), (LENGTH, y, y), (10 if short else 20, 1, 1))
    probes = {"tip": (LENGTH, 0, 0), "hub": (0, 0, 0)}
    scene = rf.Scene(domain, PLASTIC, driven(way), order=2, probes=probes)
    dt, end = (SHORT_DT, SHORT_END) if short else (DT, END)
    lags, stretches = [], []
    for report in rf.simulate(scene, dt, end, progress=False):
        turned = angle(report.t)
        along = np.array([np.cos(turned), np.sin(turned), 0.0])
        tip = report.probes["tip"] + [LENGTH, 0, 0] - report.probes["hub"]
        lags.append(float(tip[0] * along[1] - tip[1] * along[0]))
        if report.t > UP:
            assert abs(lags[-1]) <= SWING, way
            stretches.append(tip @ along - LENGTH)
    rows = [Found(f"lag of the tip, {way} [m]", LAG, max(lags), 0.01, unknowns=report.unknowns)]
    if not short:
        stretch = float(np.mean(stretches))
        title = f"stretch, {way} [m]"
        rows.append(Found(title, STRETCH, stretch, 0.01, unknowns=report.unknowns))
    return rows


def spin_up(short: bool) -> Iterator[list[Found]]:
    """All ways, one after the other."""
    for way in WAYS[2:3] if short else WAYS:
        yield spun(way, short)


SPIN_UP = Problem("J. C. Simo, L. Vu-Quoc, J. Appl. Mech. 53 (1986) 855", spin_up)

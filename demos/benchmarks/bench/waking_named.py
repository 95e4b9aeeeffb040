"""Scenes of waking.py for what grows: slow loads, blows in flight, bounces, a wave, a machine."""

from __future__ import annotations

import numpy as np

import rigidfx as rf
from meshes.mechanism import slider_crank

from .crank import BLOCK, driven
from .waking_scenes import BASE, COARSE, SOFT, STEEL, STIFF, pulse
from .waking_structures import DRAG, Built, bar, push, scene

__all__ = ["ALONE"]

PERIOD = 1.2  # s, of the stiff bar held at one end
SPEED, RAMP = 100.0, 0.02  # rad/s, s; of the crank
SPEED_OF_SOUND = float(np.sqrt(SOFT.E / SOFT.rho))


def rising(across: int) -> rf.Scene:
    """A stiff bar struck once, and bent by a load that rises over fifty of its periods."""
    both = push(40.0, lambda t: 4 * pulse(1.0, 0.5)(t) + t / (50 * PERIOD))
    return scene(bar(across), BASE, both, DRAG, stalk=STIFF)


def in_flight(across: int) -> rf.Scene:
    """A stiff free bar that turns, struck at one end and, later, beside the other."""
    mesh = bar(across).with_facets("near", lambda x: (x[1] <= 1e-9) & (x[0] <= 2 + 1e-9))
    blow = rf.Traction("near", (0.0, 0.0, 300.0), time=pulse(4.0, 0.4))
    thrown = rf.InitialVelocity(angular=(0.0, 0.0, 0.2))
    damping = rf.KelvinVoigt(2e4)
    return scene(mesh, push(400.0, pulse(1.0, 0.4)), blow, thrown, damping, stalk=STIFF)


def on_corners(across: int) -> rf.Scene:
    """A plate that tumbles on a floor, and meets it with one corner after the other."""
    plate = rf.box((0, 0, 0), (2, 2, 0.5), (4 * across, 4 * across, across))
    thrown = rf.InitialVelocity(angular=(1.0, 0.7, 0.0))
    floor = rf.Contact("z0", against=rf.Plane((0, 0, -0.3), (0, 0, 1)))
    weight, damping = rf.Gravity((0.0, 0.0, -2.0)), rf.KelvinVoigt(2e4)
    return rf.Scene(plate, SOFT, [thrown, floor, weight, damping], probes={"tip": (2, 2, 0)})


def wave(across: int) -> rf.Scene:
    """A bar of one material, into whose far half goes a wave of eight cells."""
    length = 8 / across / SPEED_OF_SOUND
    blow = rf.Traction("x1", (-3000.0, 0.0, 0.0), time=pulse(1.0, length))
    drag, probes = rf.MassDamping(0.1), {"tip": (8, 0.5, 0.5)}
    return rf.Scene(bar(across), SOFT, [BASE, blow, drag], probes=probes)


def crank(across: int) -> rf.Scene:
    """The machine of demos/mechanism.py, which meets a stop, of first-order cells."""
    size = 0.04 if across <= COARSE else 0.03

    def speed(t: float) -> float:
        s = min(t / RAMP, 1.0)
        return SPEED * s * s * (3 - 2 * s)

    made = slider_crank(size, size / 2)
    return rf.Scene(made, STEEL, driven(speed), probes={"tip": BLOCK})


ALONE: dict[str, Built] = {
    "a load that rises": Built(rising, dt=PERIOD / 20, t_end=50 * PERIOD),
    "struck in flight": Built(in_flight, dt=0.01, t_end=8.0),
    "bounces on corners": Built(on_corners, tol=0.02, dt=2e-3, t_end=1.6),
    "wave of eight cells": Built(wave, tol=0.005, dt=5e-3, t_end=2.0),
    "slider-crank with a stop": Built(crank, tol=0.05, dt=2e-4, t_end=0.06),
}

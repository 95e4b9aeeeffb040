"""Structures of the demos as scenes, for benchmarks and studies of them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

import rigidfx as rf
from meshes.block_with_cantilever import block_with_cantilever
from meshes.device import device
from meshes.gong import MALLET, gong
from meshes.mechanism import LENGTH, RADIUS, slider_crank
from meshes.robot_arm import HEIGHT, TIP, robot_arm
from meshes.spatial_frame import spatial_frame

Time = Callable[[float], float]

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)  # Pa, 1, kg/m³
POLYMER = rf.StVenantKirchhoff(E=3e9, nu=0.3, rho=1200.0)
ALUMINIUM = rf.StVenantKirchhoff(E=7e10, nu=0.33, rho=2700.0)
BLOCK = RADIUS + LENGTH + 0.069, 0.0, 0.03  # m; a corner of the slider-crank's block


def ramp(s: float) -> float:
    """A smooth rise from 0 to 1 as s goes from 0 to 1."""
    s = min(max(s, 0.0), 1.0)
    return s * s * (3 - 2 * s)


def travel(s: float) -> float:
    """A smooth way from 0 to 1, at rest and without acceleration at both ends."""
    s = min(max(s, 0.0), 1.0)
    return float(s - np.sin(2 * np.pi * s) / (2 * np.pi))


def pulse(start: float, length: float) -> Time:
    """A smooth push of height one."""
    return lambda t: float(start < t < start + length) * np.sin(np.pi * (t - start) / length) ** 2


def gong_struck(
    across: int,
    blows: Mapping[str, float],
    *more: rf.effects.Effect,
    probes: Mapping[str, Sequence[float]],
) -> rf.Scene:
    """The plate of `gong.py` in soft springs, in which it swings; a time [s] for each blow."""
    push = (0.0, 0.0, -500.0 / MALLET**2)  # Pa
    effects = [
        rf.Spring("rim", 330.0),
        rf.StiffnessDamping(ratio=0.3, frequency=20.0),
        rf.InitialVelocity(linear=(0, 0, 0.05)),
        *(rf.Traction(where, push, time=pulse(t, 0.01)) for where, t in blows.items()),
        *more,
    ]
    materials = {"plate": POLYMER, "hub": STEEL}
    return rf.Scene(gong(across), materials, effects, element="enhanced", probes=probes)


FALL, GRAVITY = 0.5, 9.81  # m, m/s²; of the device
TOUCH = float(np.sqrt(2 * FALL / GRAVITY))  # s


def device_above_floor(size: float) -> rf.Domain:
    """The device of `drop_test.py`, a corner ahead."""
    return device(size, up=(0.060, 0.035, 0.036), height=FALL)


def device_dropped(body: rf.Domain, *more: rf.effects.Effect, **how: Any) -> rf.Scene:
    """Its fall, and the floor."""
    materials = {
        "shell": rf.NeoHooke(E=2.4e9, nu=0.35, rho=1200.0),
        "board": rf.StVenantKirchhoff(E=2e10, nu=0.2, rho=1900.0),
        "heavy": rf.StVenantKirchhoff(E=1e10, nu=0.3, rho=2700.0),
    }
    effects = [
        rf.Contact("skin", against=rf.Plane((0, 0, 0), (0, 0, 1)), title="floor"),
        rf.Gravity((0, 0, -GRAVITY)),
        rf.StiffnessDamping(ratio=0.05, frequency=1000.0),
        *more,
    ]
    return rf.Scene(body, materials, effects, element="enhanced", **how)


def arm_moved(
    size: float, way: Callable[[float], tuple[float, float, float]], *more: rf.effects.Effect
) -> rf.Scene:
    """The arm of `robot_arm.py`, whose axis goes some way [m]."""
    return rf.Scene(
        robot_arm(size, max(0.012, 0.6 * size)),
        ALUMINIUM,
        [rf.PrescribedMotion("bore", displacement=way), *more],
        order=2,
        mass="consistent",
        probes={"tip": (TIP, 0.0, HEIGHT / 2)},
    )


def crank_joints(speed: Time) -> list[rf.effects.Effect]:
    """The slider-crank's joints at mean faces, and a motor by speed [rad/s]."""
    face, z, wrist = rf.MeanFace, (0.0, 0.0, 1.0), (RADIUS + LENGTH, 0.0, 0.0)
    return [
        rf.Revolute("ground", face("journals"), (0, 0, 0), z, name="bearing"),
        rf.Cylindrical(face("pin"), face("big eye"), (RADIUS, 0, 0), z, name="crank pin"),
        rf.Spherical(face("small eye"), face("wrist"), wrist, name="wrist pin"),
        rf.Prismatic("ground", face("slides"), wrist, (1, 0, 0), name="guide"),
        rf.Motor("bearing", speed=speed),
    ]


def crank_driven(speed: Time) -> list[rf.effects.Effect]:
    """The same with a stop before the dead centre, and damping, as in `mechanism.py`."""
    stop = rf.Stop("guide", low=-2 * RADIUS + 5e-4, stiffness=2e7)  # N/m
    return [*crank_joints(speed), stop, rf.NumericalDamping(0.1)]


def crank_scene(
    size: float, effects: Sequence[rf.effects.Effect], probes: Mapping[str, Sequence[float]]
) -> rf.Scene:
    """The slider-crank of steel, of second-order cells."""
    steel = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7800.0)
    mesh = slider_crank(size, size / 2)
    return rf.Scene(mesh, steel, effects, order=2, mass="consistent", probes=probes)


def block_thrown(*more: rf.effects.Effect) -> rf.Scene:
    """The block with a cantilever of `free_flying_body.py`, by loads on faces; probe "tip"."""
    domain = block_with_cantilever()
    domain = domain.with_facets("block", lambda x: (x[0] < 9.01) & (np.abs(x[2] - 3.0) > 2.99))
    domain = domain.with_facets("end", lambda x: (x[0] > 14.99) & (x[2] > 3.99))
    loads = [
        rf.Traction("block", (0.0, 0.0, -1e4), total=True, until=2.0),  # N
        rf.Traction("end", (0.0, 0.0, 1e4), total=True, until=2.0),
    ]
    material = rf.StVenantKirchhoff(E=5e5, nu=0.3, rho=100.0)
    return rf.Scene(domain, material, [*loads, *more], probes={"tip": (23.0, 2.7, 3.0)})


def frame_shocked(coarse: int, *more: rf.effects.Effect, **load: Any) -> rf.Scene:
    """The frame of `spatial_frame.py`, pushed at its side."""
    effects = [
        rf.Fixed("feet"),
        rf.Fixed("symmetry", "y"),
        rf.Traction("side", (4250.0, 0.0, 0.0), **load),  # Pa
        *more,
    ]
    material = rf.StVenantKirchhoff(E=7e10, nu=0.2, rho=2700.0)
    probes = {"tip": (6.0, 3.0, 4.5)}
    return rf.Scene(spatial_frame(coarse=coarse), material, effects, probes=probes)

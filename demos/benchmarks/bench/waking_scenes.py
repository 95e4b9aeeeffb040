"""The scenes of waking.py: what acts on parts that could be rigid most of the time.

Most are a bar, a soft stalk with a stiff block on it; others turn, hang, are preloaded, touch, are
named rigid, or are machines and parts of demos. `LARGE` are those of a mesh of their own, that the
long form alone runs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from common import machines
from common.machines import Time, pulse, ramp
from hardcases.cad_parts import lug

import rigidfx as rf
from meshes.gong import SIDE
from meshes.mechanism import slider_crank
from meshes.robot_arm import HEIGHT, TIP, robot_arm

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³
MIDDLE = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0)
STIFF = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
BASE = rf.Fixed("x0")
DRAG, DAMPING = rf.MassDamping(1.0), rf.KelvinVoigt(2e4)
WEIGHT = rf.Gravity((0.0, 0.0, -0.05))
SPIN = 0.3  # rad/s
COARSE = 2  # cells across a bar, up to which the other meshes are coarse, too
PERIOD = 1.2  # s, of the stiff bar held at one end
SPEED, RAMP = 100.0, 0.02  # rad/s, s; of the crank
SPEED_OF_SOUND = float(np.sqrt(SOFT.E / SOFT.rho))
Effects = list[rf.effects.Effect]


def sine(period: float) -> Time:
    """A sine that begins gently."""
    return lambda t: np.sin(2 * np.pi * t / period) * min(1.0, t / period)


def shake(t: float) -> tuple[float, float, float]:
    """A path of the ground: the same ten sines in each run [m]."""
    random = np.random.default_rng(5)
    frequency, phase = random.uniform(0.05, 0.6, 10), random.uniform(0, 2 * np.pi, 10)
    waves = np.sin(2 * np.pi * frequency * t + phase) - np.sin(phase)
    return 0.0, 0.0, float(2e-3 * (waves / frequency).sum() * min(1.0, t / 4) ** 2)


def turning(t: float) -> tuple[float, float, float]:
    """A gravity that turns once in 12 s [m/s²]."""
    rise = 0.1 * min(1.0, t / 6)
    return 0.0, rise * np.sin(2 * np.pi * t / 12), -rise * np.cos(2 * np.pi * t / 12)


@dataclass(frozen=True)
class Built:
    """A scene and its times."""

    build: Callable[[int], rf.Scene]  # the scene on a mesh of so many cells across
    tol: float = 0.01  # tolerance over the peak strain rate of the twin
    dt: float = 0.02  # Δt [s]
    t_end: float = 12.0  # end [s]

    def at(self, across: int) -> "Built":
        """The case on a mesh of so many cells across."""
        return self


@dataclass(frozen=True)
class AtOnesOwn(Built):
    """The bar under a sine of the longest period of its block, were that free, on its mesh."""

    def at(self, across: int) -> Built:
        """Twenty steps a period, and forty periods."""
        box = rf.box((4, 0, 0), (8, 1, 1), (4 * across, across, across))
        period = float(rf.periods(rf.Scene(box, STIFF), 1)[0])
        time, tol = sine(period), self.tol
        return halves(BASE, push(400.0, time), dt=period / 20, t_end=40 * period, tol=tol)


def stalk_and_block(
    cells: tuple[int, int, int], cut: float = 2.0, cell: str = "hexahedron"
) -> rf.Domain:
    """A bar of 8 m along x, a "stalk" up to the cut [m] and a "block" from there on."""
    box = rf.box((0, 0, 0), (8, 1, 1), cells, cell)
    box = box.with_cells("stalk", lambda x: x[0] <= cut + 1e-9)
    return box.with_cells("block", lambda x: x[0] >= cut - 1e-9)


def bar(across: int, cut: float = 2.0) -> rf.Domain:
    """The same of cubes."""
    return stalk_and_block((8 * across, across, across), cut)


def scene(
    mesh: rf.Domain,
    *effects: rf.effects.Effect,
    stalk: rf.Material = SOFT,
    block: rf.Material = STIFF,
    **how: Any,
) -> rf.Scene:
    """The bar with a probe at its tip, unless told otherwise."""
    how = {"probes": {"tip": (8, 0.5, 0.5)}} | how
    return rf.Scene(mesh, {"stalk": stalk, "block": block}, effects, **how)


def halves(
    *effects: rf.effects.Effect, block: rf.Material = STIFF, damping: float = 1.0, **times: Any
) -> Built:
    """The bar, its outer half a block, under effects and a drag α [1/s]."""
    drag = [rf.MassDamping(damping)] if damping else []
    build = lambda across: scene(bar(across, 4.0), *effects, *drag, block=block)  # noqa: E731
    return Built(build, **({"t_end": 16.0} | times))


def push(height: float, time: Time) -> rf.Traction:
    """A push on the end, across [Pa]."""
    return rf.Traction("x1", (0.0, 0.0, height), time=time)


def swinging(period: float, reach: float) -> rf.PrescribedMotion:
    """A base that swings sideways [m]."""
    wave = sine(period)
    return rf.PrescribedMotion("x0", displacement=lambda t: (0.0, 0.0, reach * float(wave(t))))


def struck(across: int) -> rf.Scene:
    """The plate of demos/gong.py, damped, in soft springs, in which it swings, and two blows."""
    blows = {"corner": 0.1, "side": 0.4}  # s
    return machines.gong_struck(16 * max(1, across // 2), blows, probes={"tip": (SIDE, SIDE, 0)})


def arm(across: int) -> rf.Scene:
    """The arm of demos/robot_arm.py, of first-order cells, in a bearing that gives.

    A torque on the bore, a sine for ever, acts against the stiffness of its servo.
    """

    def round_the_axis(x: np.ndarray, t: float) -> np.ndarray:
        tangent = np.stack([-x[1], x[0], 0 * x[0]]) / np.hypot(x[0], x[1])
        return np.asarray(5e4 * sine(0.1)(t) * tangent)  # Pa

    effects = [
        rf.Spring("bore", 1e6),
        rf.Traction("bore", round_the_axis),
        rf.MassDamping(10.0),
        rf.StiffnessDamping(ratio=0.02, frequency=100.0),
    ]
    size, leaf = (0.02, 0.012) if across <= COARSE else (0.008, 0.005)
    probe = {"tip": (TIP, 0.0, HEIGHT / 2)}
    return rf.Scene(robot_arm(size, leaf), machines.ALUMINIUM, effects, probes=probe)


def frame(across: int) -> rf.Scene:
    """The frame of demos/spatial_frame.py under two shocks on its side."""
    both = lambda t: pulse(0.0, 0.05)(t) + pulse(1.6, 0.05)(t)  # noqa: E731
    coarse = 3 if across <= COARSE else 1
    return machines.frame_shocked(coarse, rf.NumericalDamping(0.35), time=both)


def rotor(across: int) -> rf.Scene:
    """A bar that turns steadily from its start on, pushed along its axis of rotation."""
    turn = rf.PrescribedRotation(
        "x0", axis=(0, 0, 1), through=(0, 0.5, 0.5), angle=lambda t: SPIN * t
    )
    spun = rf.Preload(spin=(0.0, 0.0, SPIN))
    return scene(bar(across), turn, spun, push(100.0, sine(3.0)), DRAG, stalk=MIDDLE)


def pendulum(across: int) -> rf.Scene:
    """A bar on an edge, about which it falls by a small weight, damped."""
    edge = bar(across).with_vertices("edge", lambda x: (x[0] <= 1e-9) & (x[2] >= 1 - 1e-9))
    return scene(edge, rf.Fixed("edge"), WEIGHT, rf.MassDamping(0.1), DAMPING)


def preloaded(across: int) -> rf.Scene:
    """A bar that sags by its weight, from its equilibrium on, pushed twice."""
    twice = push(20.0, lambda t: pulse(1.0, 2.0)(t) + pulse(7.0, 2.0)(t))
    return scene(bar(across), BASE, WEIGHT, rf.Preload([WEIGHT]), twice, DRAG)


def on_a_floor(across: int) -> rf.Scene:
    """A bar that lies on a floor, pressed on it by a force that swells."""
    floor = rf.Contact("z0", against=rf.Plane((0, 0, 0), (0, 0, 1)))
    swell = push(-300.0, lambda t: 1 + sine(3.0)(t) if t > 2 else t / 2)
    return scene(bar(across, cut=4.0), BASE, floor, swell, DRAG, DAMPING)


def beside_rigid(across: int) -> rf.Scene:
    """A bar of which a part is named rigid, between what is soft and what is stiff."""
    named = bar(across).with_cells("root", lambda x: (x[0] >= 2 - 1e-9) & (x[0] <= 4 + 1e-9))
    return scene(named, BASE, rf.Rigid("root"), push(100.0, sine(3.0)), DRAG)


def cad_part(across: int) -> rf.Scene:
    """The lug of second-order tetrahedra with consistent mass, bent."""
    steel_like = rf.StVenantKirchhoff(E=2e7, nu=0.3, rho=1000.0)
    bend = rf.Traction("right", (0.0, 0.0, 100.0), time=sine(4.0))
    effects, probes = [rf.Fixed("left"), bend, DRAG], {"tip": (10.0, 0.5, 0.5)}
    mesh = lug(1.0 if across <= COARSE else 0.6)
    return rf.Scene(mesh, steel_like, effects, order=2, mass="consistent", probes=probes)


def rising(across: int) -> rf.Scene:
    """A stiff bar struck once, and bent by a load that rises over fifty of its periods."""
    both = push(40.0, lambda t: 4 * pulse(1.0, 0.5)(t) + t / (50 * PERIOD))
    return scene(bar(across), BASE, both, DRAG, stalk=STIFF)


def in_flight(across: int) -> rf.Scene:
    """A stiff free bar that turns, struck at one end and, later, beside the other."""
    mesh = bar(across).with_facets("near", lambda x: (x[1] <= 1e-9) & (x[0] <= 2 + 1e-9))
    blow = rf.Traction("near", (0.0, 0.0, 300.0), time=pulse(4.0, 0.4))
    thrown = rf.InitialVelocity(angular=(0.0, 0.0, 0.2))
    return scene(mesh, push(400.0, pulse(1.0, 0.4)), blow, thrown, DAMPING, stalk=STIFF)


def on_corners(across: int) -> rf.Scene:
    """A plate that tumbles on a floor, and meets it with one corner after the other."""
    plate = rf.box((0, 0, 0), (2, 2, 0.5), (4 * across, 4 * across, across))
    thrown = rf.InitialVelocity(angular=(1.0, 0.7, 0.0))
    floor = rf.Contact("z0", against=rf.Plane((0, 0, -0.3), (0, 0, 1)))
    effects = [thrown, floor, rf.Gravity((0.0, 0.0, -2.0)), DAMPING]
    return rf.Scene(plate, SOFT, effects, probes={"tip": (2, 2, 0)})


def wave(across: int) -> rf.Scene:
    """A bar of one material, into whose far half goes a wave of eight cells."""
    length = 8 / across / SPEED_OF_SOUND
    blow = rf.Traction("x1", (-3000.0, 0.0, 0.0), time=pulse(1.0, length))
    drag, probes = rf.MassDamping(0.1), {"tip": (8, 0.5, 0.5)}
    return rf.Scene(bar(across), SOFT, [BASE, blow, drag], probes=probes)


def crank(across: int) -> rf.Scene:
    """The machine of demos/mechanism.py, which meets a stop, of first-order cells."""
    size = 0.04 if across <= COARSE else 0.03
    effects = machines.crank_driven(lambda t: SPEED * ramp(t / RAMP))
    made = slider_crank(size, size / 2)
    return rf.Scene(made, machines.STEEL, effects, probes={"tip": machines.BLOCK})


def large(across: int) -> Callable[[int], rf.Scene]:
    """A bar whose outer half is a stiff block, pushed by a sine, on a mesh of its own."""
    return lambda _: scene(bar(across, cut=4.0), BASE, push(200.0, sine(4.0)), DRAG)


twist = pulse(2.0, 6.0)
CASES: dict[str, Built] = {
    "gong": Built(struck, tol=0.03, dt=2e-3, t_end=0.6),
    "sine on a block": halves(BASE, push(200.0, sine(4.0))),
    "shaken base": halves(swinging(3.0, 0.05)),
    "slow sine": halves(BASE, push(200.0, sine(12.0))),
    "accelerogram": halves(rf.PrescribedMotion("x0", displacement=shake)),
    "turning gravity": halves(BASE, rf.Gravity(turning)),
    "wave into a half": halves(
        BASE, rf.Traction("x1", (-3000.0, 0, 0), time=pulse(1.0, 0.2)), block=SOFT, dt=0.01,
        t_end=4.0, tol=0.005, damping=0.1,
    ),
    "arm, sine of its motor": Built(arm, tol=0.03, dt=5e-3, t_end=2.0),
    "frame, two shocks": Built(frame, tol=0.02, dt=0.01, t_end=3.2),
    "sine, resonance of the whole": halves(BASE, push(20.0, sine(9.6)), t_end=40.0),
    "sine, resonance of the block": AtOnesOwn(bar),
    "sine, near a higher one": halves(BASE, push(400.0, sine(0.24)), dt=0.01, t_end=8.0),
    "local sine on a damped bar": halves(
        BASE, rf.NodalForce("x1", (0, 0, 100.0), time=sine(2.0)), DAMPING, block=SOFT,
        damping=3.0, tol=0.03,
    ),
    "lateral pulse off centre": halves(
        BASE, rf.Traction("y1", (0, 0, 400.0), time=pulse(3.0, 0.3)), damping=2.0
    ),
    "spin-up": halves(
        rf.Traction("y1", (-30.0, 0, 0), time=twist), rf.Traction("y0", (30.0, 0, 0), time=twist),
        DAMPING, damping=0.0,
    ),
    "rotor": Built(rotor),
    "pendulum": Built(pendulum, tol=0.02),
    "preloaded bar": Built(preloaded),
    "bar on a floor": Built(on_a_floor),
    "a named part beside": Built(beside_rigid),
    "part of CAD, second order": Built(cad_part, t_end=16.0),
    "a load that rises": Built(rising, dt=PERIOD / 20, t_end=50 * PERIOD),
    "struck in flight": Built(in_flight, dt=0.01, t_end=8.0),
    "bounces on corners": Built(on_corners, tol=0.02, dt=2e-3, t_end=1.6),
    "wave of eight cells": Built(wave, tol=0.005, dt=5e-3, t_end=2.0),
    "slider-crank with a stop": Built(crank, tol=0.05, dt=2e-4, t_end=0.06),
}  # fmt: skip
LARGE: dict[str, Built] = {  # of 1000 steps
    "20 000 unknowns": Built(large(9), t_end=20.0),
    "60 000 unknowns": Built(large(13), t_end=20.0),
}

"""More scenes of waking.py: what turns, hangs, is preloaded, touches, is named rigid, or is large.

`Built` is a scene of a function, with its times; `STRUCTURES` are those of any mesh, `LARGE` those
of a mesh of their own, that the long form alone runs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hardcases.cad_parts import lug

import rigidfx as rf

from .waking_scenes import BASE, COARSE, SOFT, STIFF, pulse, sine

__all__ = ["LARGE", "STRUCTURES", "Built"]

MIDDLE = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0)
DRAG = rf.MassDamping(1.0)
SPIN = 0.3  # rad/s
WEIGHT = rf.Gravity((0.0, 0.0, -0.05))


@dataclass(frozen=True)
class Built:
    """A scene and its times.

    Attributes:
        build: The scene on a mesh of so many cells across.
        tol: Tolerance over the peak strain rate of the twin.
        dt: Δt [s].
        t_end: End [s].
    """

    build: Callable[[int], rf.Scene]
    tol: float = 0.01
    dt: float = 0.02
    t_end: float = 12.0

    def at(self, across: int) -> Built:
        """The case on a mesh of so many cells across."""
        return self

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh of so many cells across."""
        return self.build(across)


def bar(across: int, cut: float = 2.0) -> rf.Domain:
    """A bar along x, a "stalk" up to the cut [m] and a "block" from there on."""
    box = rf.box((0, 0, 0), (8, 1, 1), (8 * across, across, across))
    box = box.with_cells("stalk", lambda x: x[0] <= cut + 1e-9)
    return box.with_cells("block", lambda x: x[0] >= cut - 1e-9)


def scene(mesh: rf.Domain, *effects: rf.effects.Effect, stalk: rf.Material = SOFT) -> rf.Scene:
    """The bar with a probe at its tip."""
    materials = {"stalk": stalk, "block": STIFF}
    return rf.Scene(mesh, materials, effects, probes={"tip": (8, 0.5, 0.5)})


def push(height: float, time: Callable[[float], float]) -> rf.Traction:
    """A push on the end, across [Pa]."""
    return rf.Traction("x1", (0.0, 0.0, height), time=time)


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
    damping = rf.MassDamping(0.1), rf.KelvinVoigt(2e4)
    return scene(edge, rf.Fixed("edge"), WEIGHT, *damping)


def preloaded(across: int) -> rf.Scene:
    """A bar that sags by its weight, from its equilibrium on, pushed twice."""
    twice = push(20.0, lambda t: pulse(1.0, 2.0)(t) + pulse(7.0, 2.0)(t))
    return scene(bar(across), BASE, WEIGHT, rf.Preload([WEIGHT]), twice, DRAG)


def on_a_floor(across: int) -> rf.Scene:
    """A bar that lies on a floor, pressed on it by a force that swells."""
    floor = rf.Contact("z0", against=rf.Plane((0, 0, 0), (0, 0, 1)))
    swell = push(-300.0, lambda t: 1 + sine(3.0)(t) if t > 2 else t / 2)
    return scene(bar(across, cut=4.0), BASE, floor, swell, DRAG, rf.KelvinVoigt(2e4))


def beside_rigid(across: int) -> rf.Scene:
    """A bar of which a part is named rigid, between what is soft and what is stiff."""
    named = bar(across).with_cells("root", lambda x: (x[0] >= 2 - 1e-9) & (x[0] <= 4 + 1e-9))
    return scene(named, BASE, rf.Rigid("root"), push(100.0, sine(3.0)), DRAG)


def cad_part(across: int) -> rf.Scene:
    """The lug of second-order tetrahedra with consistent mass, bent."""
    steel_like = rf.StVenantKirchhoff(E=2e7, nu=0.3, rho=1000.0)
    bend = rf.Traction("right", (0.0, 0.0, 100.0), time=sine(4.0))
    return rf.Scene(
        lug(1.0 if across <= COARSE else 0.6),
        steel_like,
        [rf.Fixed("left"), bend, DRAG],
        order=2,
        mass="consistent",
        probes={"tip": (10.0, 0.5, 0.5)},
    )


def large(across: int) -> Callable[[int], rf.Scene]:
    """A bar whose outer half is a stiff block, pushed by a sine, on a mesh of its own."""
    return lambda _: scene(bar(across, cut=4.0), BASE, push(200.0, sine(4.0)), DRAG)


STRUCTURES: dict[str, Built] = {
    "rotor": Built(rotor),
    "pendulum": Built(pendulum, tol=0.02),
    "preloaded bar": Built(preloaded),
    "bar on a floor": Built(on_a_floor),
    "a named part beside": Built(beside_rigid),
    "part of CAD, second order": Built(cad_part, t_end=16.0),
}
LARGE: dict[str, Built] = {  # of 1000 steps
    "20 000 unknowns": Built(large(9), t_end=20.0),
    "60 000 unknowns": Built(large(13), t_end=20.0),
}

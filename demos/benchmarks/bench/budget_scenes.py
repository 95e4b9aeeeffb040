"""Scenes for budgets: the three structures of the study of accuracy, and loads of nine kinds.

Damping is by a viscosity that does not depend on Δt (a numerical one would change with it, and a
finer run be another structure).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from common.machines import block_thrown, frame_shocked, pulse

import rigidfx as rf
from meshes.tumbling_l import tumbling_l

from .waking_scenes import BASE, scene, sine
from .waking_scenes import bar as stalk_and_block

BUDGETS = 0.05, 0.01, 0.002


@dataclass(frozen=True)
class Case:
    """A scene with a probe "end"."""

    scene: Callable[[], rf.Scene]  # the problem
    largest: float  # largest Δt [s]
    t_end: float  # end [s]
    # least cells of a body, in place of those that are worth it: a small bar stands for a large one
    min_cells: int | None = None
    budgets: tuple[float, ...] = BUDGETS  # the budgets that its references allow


def viscous(beta: float) -> rf.StiffnessDamping:
    """The stress β ℂ:ΔE/Δt, which the numerical damping ξ = β/Δt makes [s]."""
    return rf.StiffnessDamping(ratio=beta * np.pi, frequency=1.0)


def body() -> rf.Scene:
    """The block with a cantilever, thrown into a turn."""
    return block_thrown(viscous(0.025))


def frame() -> rf.Scene:
    """The plate on four columns, under a shock."""
    return frame_shocked(3, "end", viscous(0.00125), until=0.05)


def tumbling(refine: int = 1) -> rf.Scene:
    """The L, pushed and let go."""
    load = np.array([256.0, 512.0, 768.0]) / 90  # Pa/s
    ramp = rf.Table([0.0, 2.5, 5.0], [0.0, 2.5, 0.0])  # s
    effects = [
        rf.Traction("top", tuple(load), time=ramp, until=5.0),
        rf.Traction("side", tuple(-load), time=ramp, until=5.0),
    ]
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    return rf.Scene(tumbling_l(refine), material, effects, probes={"end": (0.0, 10.0, 1.5)})


def bar(*effects: rf.effects.Effect, drag: float = 1.0) -> rf.Scene:
    """A soft stalk with a stiff block on it."""
    damped = [*effects, rf.MassDamping(drag)] if drag else effects
    return scene(stalk_and_block(2, 4.0), *damped, probe="end")


def arch(t: float) -> float:
    """Half a sine until 2 s."""
    return float(np.sin(np.pi * t / 2))


def moved(t: float) -> tuple[float, float, float]:
    """How a base moves [m]."""
    return 0.0, 0.0, 0.05 * sine(3.0)(t)


def quake() -> rf.Table:
    """Numbers at random, smoothed over a second, one each 0.05 s."""
    t = np.arange(0, 16.01, 0.05)
    noise = np.random.default_rng(3).standard_normal(len(t) + 20)
    smooth = np.convolve(noise, np.hanning(21), "same")[: len(t)]
    return rf.Table(tuple(t), tuple(0.3 * smooth * np.minimum(1, t / 2)))


def on_bar(scene: Callable[[], rf.Scene], budgets: tuple[float, ...] = BUDGETS) -> Case:
    """A case of the bar."""
    return Case(scene, 0.2, 16.0, 8, budgets)


def resonance() -> rf.Scene:
    """A sine with the period of the first bending, which grows for five of them."""
    pull = rf.Traction("x1", (0, 0, 5.0), time=lambda t: float(np.sin(2 * np.pi * t / 11.46)))
    return bar(BASE, pull, drag=0.1)


CASES = {
    "frame": Case(frame, 0.02, 1.25),
    "tumbling L": Case(tumbling, 0.4, 20.0),
    "free-flying body": Case(body, 0.4, 30.0),
    "sine": on_bar(lambda: bar(BASE, rf.Traction("x1", (0, 0, 200.0), time=sine(4.0)))),
    "push": on_bar(lambda: bar(BASE, rf.Traction("x1", (0, 0, 200.0), time=arch, until=2.0))),
    "free bar": on_bar(
        lambda: bar(rf.InitialVelocity(angular=(0.3, 1.0, 0.5)), viscous(0.005), drag=0.0),
        BUDGETS[:2],
    ),
    "shock at rest": on_bar(
        lambda: bar(BASE, rf.Traction("x1", (0, 0, 2000.0), since=4.0, until=4.1)), BUDGETS[:2]
    ),
    "spin-up": on_bar(
        lambda: bar(
            *(
                rf.Traction(face, (sign * 30.0, 0, 0), time=pulse(2.0, 6.0))
                for face, sign in (("y1", -1.0), ("y0", 1.0))
            ),
            rf.KelvinVoigt(2e4),
            drag=0.0,
        )
    ),
    "resonance": Case(resonance, 0.5, 60.0, 8, BUDGETS[:2]),
    "moving base": on_bar(lambda: bar(rf.PrescribedMotion("x0", displacement=moved))),
    "pressure": on_bar(lambda: bar(BASE, rf.Pressure("z0", 30.0, since=1.0))),
    "accelerogram": on_bar(lambda: bar(BASE, rf.Gravity((0, 0, 1.0), time=quake()))),
}

"""The scenes of waking.py: what acts on parts that could be rigid most of the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import rigidfx as rf
from meshes.gong import MALLET, SIDE, gong
from meshes.robot_arm import HEIGHT, TIP, robot_arm
from meshes.spatial_frame import spatial_frame

__all__ = ["CASES", "Case"]

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³
STIFF = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
POLYMER = rf.StVenantKirchhoff(E=3e9, nu=0.3, rho=1200.0)
ALUMINIUM = rf.StVenantKirchhoff(E=7e10, nu=0.33, rho=2700.0)
BASE = rf.Fixed("x0")
COARSE = 2  # cells across a bar, up to which the other meshes are coarse, too
Effects = list[rf.effects.Effect]


def pulse(start: float, length: float) -> Callable[[float], float]:
    """A smooth push of height one."""
    return lambda t: float(start < t < start + length) * np.sin(np.pi * (t - start) / length) ** 2


def sine(period: float) -> Callable[[float], float]:
    """A sine that begins gently."""
    return lambda t: np.sin(2 * np.pi * t / period) * min(1.0, t / period)


def shake(t: float) -> tuple[float, float, float]:
    """A path of the ground: the same ten sines in each run [m]."""
    random = np.random.default_rng(5)
    frequency, phase = random.uniform(0.05, 0.6, 10), random.uniform(0, 2 * np.pi, 10)
    waves = np.sin(2 * np.pi * frequency * t + phase) - np.sin(phase)
    return 0.0, 0.0, float(2e-3 * (waves / frequency).sum() * min(1.0, t / 4) ** 2)


def swinging(period: float, reach: float) -> Callable[[float], tuple[float, float, float]]:
    """A path that swings sideways [m]."""
    wave = sine(period)
    return lambda t: (0.0, 0.0, reach * float(wave(t)))


def turning(t: float) -> tuple[float, float, float]:
    """A gravity that turns once in 12 s [m/s²]."""
    rise = 0.1 * min(1.0, t / 6)
    return 0.0, rise * np.sin(2 * np.pi * t / 12), -rise * np.cos(2 * np.pi * t / 12)


@dataclass(frozen=True)
class Case:
    """A bar, its outer half a stiff block or as soft as the rest, and what acts on it.

    Attributes:
        effects: What acts, supports included.
        block: Whether the outer half is stiff.
        tol: Tolerance over the peak strain rate of the twin.
        dt: Δt [s].
        t_end: End [s].
        damping: α of the drag [1/s].
    """

    effects: Callable[..., Effects]
    block: bool = True
    tol: float = 0.01
    dt: float = 0.02
    t_end: float = 16.0
    damping: float = 1.0

    def at(self, across: int) -> Case:
        """The case on a mesh of so many cells across."""
        return self

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh of so many cells across."""
        box = rf.box((0, 0, 0), (8, 1, 1), (8 * across, across, across))
        box = box.with_cells("stalk", lambda x: x[0] <= 4 + 1e-9)
        box = box.with_cells("block", lambda x: x[0] >= 4 - 1e-9)
        materials = {"stalk": SOFT, "block": STIFF if self.block else SOFT}
        drag = [rf.MassDamping(self.damping)] if self.damping else []
        return rf.Scene(box, materials, [*self.effects(), *drag], probes={"tip": (8, 0.5, 0.5)})


@dataclass(frozen=True)
class AtOnesOwn(Case):
    """The bar under a sine of the longest period of its block, were that free, on its mesh."""

    def at(self, across: int) -> Case:
        """See `Case`: twenty steps a period, and forty periods."""
        box = rf.box((4, 0, 0), (8, 1, 1), (4 * across, across, across))
        period = float(rf.periods(rf.Scene(box, STIFF), 1)[0])
        effects = self.effects
        return Case(lambda: effects(period), dt=period / 20, t_end=40 * period, tol=self.tol)


@dataclass(frozen=True)
class Gong(Case):
    """A plate with a heavy hub instead, of demos/gong.py."""

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh of eight times as many cells along a side, in sixteens."""
        return rf.Scene(
            gong(16 * max(1, across // 2)),
            {"plate": POLYMER, "hub": STEEL},
            self.effects(),
            element="enhanced",
            probes={"tip": (SIDE, SIDE, 0)},
        )


@dataclass(frozen=True)
class Arm(Case):
    """The arm of demos/robot_arm.py instead, of first-order cells, in a bearing that gives."""

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh that is coarse or fine."""
        size, leaf = (0.02, 0.012) if across <= COARSE else (0.008, 0.005)
        probe = {"tip": (TIP, 0.0, HEIGHT / 2)}
        return rf.Scene(robot_arm(size, leaf), ALUMINIUM, self.effects(), probes=probe)


@dataclass(frozen=True)
class Frame(Case):
    """The frame of demos/spatial_frame.py instead."""

    def scene(self, across: int) -> rf.Scene:
        """The problem on a mesh whose plate is coarse or fine."""
        mesh = spatial_frame(coarse=3 if across <= COARSE else 1)
        material = rf.StVenantKirchhoff(E=7e10, nu=0.2, rho=2700.0)
        return rf.Scene(mesh, material, self.effects(), probes={"tip": (6.0, 3.0, 4.5)})


def struck() -> Effects:
    """The plate damped, in soft springs, in which it swings, and two blows."""
    pressure = (0.0, 0.0, -500.0 / MALLET**2)  # Pa
    blows = {"corner": pulse(0.1, 0.01), "side": pulse(0.4, 0.01)}
    return [
        rf.Spring("rim", 330.0),
        rf.StiffnessDamping(ratio=0.3, frequency=20.0),
        rf.InitialVelocity(linear=(0, 0, 0.05)),
        *(rf.Traction(name, pressure, time=time) for name, time in blows.items()),
    ]


def motor() -> Effects:
    """A torque on the bore of the arm, a sine for ever, against the stiffness of its servo."""

    def round_the_axis(x: np.ndarray, t: float) -> np.ndarray:
        tangent = np.stack([-x[1], x[0], 0 * x[0]]) / np.hypot(x[0], x[1])
        return np.asarray(5e4 * sine(0.1)(t) * tangent)  # Pa

    return [
        rf.Spring("bore", 1e6),
        rf.Traction("bore", round_the_axis),
        rf.MassDamping(10.0),
        rf.StiffnessDamping(ratio=0.02, frequency=100.0),
    ]


def shocks() -> Effects:
    """Two shocks on the side of the frame."""
    both = lambda t: pulse(0.0, 0.05)(t) + pulse(1.6, 0.05)(t)  # noqa: E731
    return [
        rf.Fixed("feet"),
        rf.Fixed("symmetry", "y"),
        rf.Traction("side", (4250.0, 0.0, 0.0), time=both),
        rf.NumericalDamping(0.35),
    ]


def push(where: str, force: tuple[float, float, float], time: Callable[[float], float]) -> Effects:
    """The bar clamped and pushed [Pa]."""
    return [BASE, rf.Traction(where, force, time=time)]


def ground(path: Callable[[float], tuple[float, float, float]]) -> Effects:
    """The bar on a ground that moves."""
    return [rf.PrescribedMotion("x0", displacement=path)]


def twisted(t: float) -> float:
    """A torque's rise and end."""
    return pulse(2.0, 6.0)(t)


CASES: dict[str, Case] = {
    "gong": Gong(struck, tol=0.03, dt=2e-3, t_end=0.6),
    "sine on a block": Case(lambda: push("x1", (0, 0, 200.0), sine(4.0))),
    "shaken base": Case(lambda: ground(swinging(3.0, 0.05))),
    "slow sine": Case(lambda: push("x1", (0, 0, 200.0), sine(12.0))),
    "accelerogram": Case(lambda: ground(shake)),
    "turning gravity": Case(lambda: [BASE, rf.Gravity(turning)]),
    "wave into a half": Case(
        lambda: push("x1", (-3000.0, 0, 0), pulse(1.0, 0.2)), block=False, dt=0.01, t_end=4.0,
        tol=0.005, damping=0.1,
    ),
    "arm, sine of its motor": Arm(motor, tol=0.03, dt=5e-3, t_end=2.0),
    "frame, two shocks": Frame(shocks, tol=0.02, dt=0.01, t_end=3.2),
    "sine, resonance of the whole": Case(lambda: push("x1", (0, 0, 20.0), sine(9.6)), t_end=40.0),
    "sine, resonance of the block": AtOnesOwn(lambda T: push("x1", (0, 0, 400.0), sine(T))),
    "sine, near a higher one": Case(
        lambda: push("x1", (0, 0, 400.0), sine(0.24)), dt=0.01, t_end=8.0
    ),
    "local sine on a damped bar": Case(
        lambda: [BASE, rf.NodalForce("x1", (0, 0, 100.0), time=sine(2.0)), rf.KelvinVoigt(2e4)],
        block=False, damping=3.0, tol=0.03,
    ),
    "lateral pulse off centre": Case(
        lambda: push("y1", (0, 0, 400.0), pulse(3.0, 0.3)), damping=2.0
    ),
    "spin-up": Case(
        lambda: [
            rf.Traction("y1", (-30.0, 0, 0), time=twisted),
            rf.Traction("y0", (30.0, 0, 0), time=twisted),
            rf.KelvinVoigt(2e4),
        ],
        damping=0.0,
    ),
}  # fmt: skip

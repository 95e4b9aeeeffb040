"""Random scenes of waking.py by number: bars, plates, posts, tables and blocks on stalks.

Each is of two materials, held at one side, and acted on by one of six loads; a number gives the
same scene everywhere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from common.machines import pulse

import rigidfx as rf

from .waking_scenes import Built, Effects, sine

STEPS = 800
Draw = np.random.Generator


@dataclass(frozen=True)
class Structure:
    """A mesh of cells "soft" and "hard", and where it is held, pushed and looked at."""

    mesh: rf.Domain  # the mesh
    support: str  # facets that are held
    push: str  # facets that are pushed
    tip: tuple[float, float, float]  # place of the probe [m]
    soft: float  # Young's modulus of the soft cells over that which is drawn
    hard: float  # the same of the hard cells
    rho: float = 1000.0  # density of the hard cells [kg/m³]

    def materials(self, E: float) -> dict[str, rf.Material]:
        """Materials by name, for a modulus that is drawn [Pa]."""
        of = {"soft": (self.soft, 1000.0), "hard": (self.hard, self.rho)}
        return {
            name: rf.StVenantKirchhoff(E=E * k, nu=0.3, rho=rho) for name, (k, rho) in of.items()
        }


def cut(size: Sequence[float], cells: Sequence[int], cell: str, axis: int, at: float) -> rf.Domain:
    """A box whose cells are soft up to a place along an axis [m], and hard from there on."""
    box = rf.box((0, 0, 0), size, cells, cell)
    box = box.with_cells("soft", lambda x: x[axis] <= at + 1e-9)
    return box.with_cells("hard", lambda x: x[axis] >= at - 1e-9)


def _bar(draw: Draw, ratio: float, cell: str) -> Structure:
    n, length = int(draw.integers(12, 24)), draw.uniform(5, 10)
    at = round(draw.uniform(0.3, 0.7) * n) * length / n
    mesh = cut((length, 1, 1), (n, 2, 2), cell, 0, at)
    soft, hard = (1.0, ratio) if draw.uniform() < 0.7 else (ratio, 1.0)
    return Structure(mesh, "x0", "x1", (length, 0.5, 0.5), soft, hard)


def _plate(draw: Draw, ratio: float, cell: str) -> Structure:
    n, side = int(draw.integers(8, 12)), draw.uniform(3, 5)
    at = round(draw.uniform(0.4, 0.6) * n) * side / n
    mesh = cut((side, side, 0.4), (n, n, 1), cell, 1, at)
    return Structure(mesh, "x0", "z1", (side, side, 0.2), 1.0, ratio)


def _post(draw: Draw, ratio: float, cell: str) -> Structure:
    mesh = cut((1, 1, 5), (2, 2, 10), cell, 2, 2.5)
    return Structure(mesh, "z0", "x1", (0.5, 0.5, 5), 1.0, ratio, rho=3000.0)


def _table(draw: Draw, ratio: float, cell: str) -> Structure:
    mesh = cut((4, 3, 1), (8, 6, 2), cell, 2, 0.5)
    return Structure(mesh, "z0", "x1", (4, 3, 1), 0.05, ratio)


def _stalk(draw: Draw, ratio: float, cell: str) -> Structure:
    mesh = cut((8, 1, 1), (16, 2, 2), cell, 0, 2.0)
    return Structure(mesh, "x0", "x1", (8, 0.5, 0.5), 1.0, 100.0)


KINDS = {"bar": _bar, "plate": _plate, "post": _post, "table": _table, "stalk": _stalk}


@dataclass(frozen=True)
class Setting:
    """What loads are drawn for."""

    of: Structure  # the structure
    period: float  # its longest one [s]
    dt: float  # Δt [s]
    force: tuple[float, ...]  # traction of a push [Pa]
    way: np.ndarray  # a direction

    def pushed(self, time: Callable[[float], float]) -> Effects:
        """Held at the support, and pushed."""
        return [
            rf.Fixed(self.of.support),
            rf.Traction(self.of.push, self.force, time=time),
        ]


def _pulse(draw: Draw, at: Setting) -> Effects:
    return at.pushed(pulse(40 * at.dt, draw.uniform(0.1, 1) * at.period))


def _sine(draw: Draw, at: Setting) -> Effects:
    return at.pushed(sine(draw.uniform(0.7, 4) * at.period))


def _shake(draw: Draw, at: Setting) -> Effects:
    frequency = draw.uniform(0.2, 1.2, 5) / at.period
    phase = draw.uniform(0, 6.28, 5)

    def path(t: float) -> tuple[float, ...]:
        waves = np.sin(2 * np.pi * frequency * t + phase) - np.sin(phase)
        reach = 0.02 * (waves / (frequency * at.period)).sum()
        return tuple(float(x) for x in reach * min(1.0, t / (2 * at.period)) ** 2 * at.way)

    return [rf.PrescribedMotion(at.of.support, displacement=path)]


def _weight(draw: Draw, at: Setting) -> Effects:
    def growing(t: float) -> tuple[float, ...]:
        return tuple(float(x) for x in 0.05 * min(1.0, t / (2 * at.period)) * at.way)

    return [rf.Fixed(at.of.support), rf.Gravity(growing)]


def _two_blows(draw: Draw, at: Setting) -> Effects:
    blows = [pulse(first * at.dt, 0.2 * at.period) for first in (40, 400)]
    return at.pushed(lambda t: blows[0](t) + blows[1](t))


def _path(draw: Draw, at: Setting) -> Effects:
    heights = np.r_[0.0, draw.uniform(-1, 1, 6)]
    knots = np.linspace(0, STEPS * at.dt, len(heights))
    return at.pushed(lambda t: float(np.interp(t, knots, heights)))


LOADS = {
    "pulse": _pulse,
    "sine": _sine,
    "shake": _shake,
    "weight": _weight,
    "two blows": _two_blows,
    "path": _path,
}


def random_case(seed: int) -> tuple[str, Built]:
    """The name of the scene of a number, and the scene."""
    draw = np.random.default_rng(1000 + seed)
    kind = list(KINDS)[seed % len(KINDS)]
    E, ratio = 10 ** draw.uniform(6, 7), 10 ** draw.uniform(0, 2)
    cell = "tetrahedron" if draw.uniform() < 0.25 else "hexahedron"
    mass = "consistent" if draw.uniform() < 0.25 else "lumped"
    of = KINDS[kind](draw, ratio, cell)
    materials, probes = of.materials(E), {"tip": of.tip}
    held = rf.Scene(of.mesh, materials, [rf.Fixed(of.support)], probes=probes)
    period = float(rf.periods(held, 3)[0])
    dt = period / draw.uniform(30, 80)
    load = list(LOADS)[int(draw.integers(0, len(LOADS)))]
    pressure = E * 10 ** draw.uniform(-4.5, -3.5)
    way = draw.normal(size=3)
    way /= np.linalg.norm(way)
    effects = LOADS[load](draw, Setting(of, period, dt, tuple(pressure * way), way))
    drag = 2 * draw.uniform(0.005, 0.08) * 2 * np.pi / period
    effects.append(rf.MassDamping(drag))
    if draw.uniform() < 0.3:
        ratio = draw.uniform(0.01, 0.05)
        effects.append(rf.StiffnessDamping(ratio=ratio, frequency=3 / period))
    tol = float(draw.choice([0.005, 0.01, 0.02, 0.03]))
    scene = rf.Scene(of.mesh, materials, effects, probes=probes, mass=mass)
    name = f"{seed}: {kind}, {load}, {cell}s, {mass} mass"
    return name, Built(lambda _: scene, tol, dt, STEPS * dt)

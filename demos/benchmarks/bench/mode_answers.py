"""Modes against exact and converged values, and what 200 000 unknowns take.

* *free bar*, *clamped bar*: the first bending frequency of Bernoulli's slender beam.
* *plate*: the first frequency of a clamped square plate by Kirchhoff's theory, 35.985 √(D/ρh)/a²
  (A. W. Leissa, Vibration of Plates, NASA SP-160, 1969).
* *tuning fork*: four modes of a free fork, a bar bent to a U. The references are extrapolated from
  four meshes by the orders that errors have along and across. The
  second mode twists the prongs: its error is that of the cells across, 2e-4 with four of them.
* *pulled string*: a hinged bar about a static state, f² = (π/L)²/4π² (N/μ + (π/L)² EI/μ).
* *200 000 unknowns*: six modes of a plate and of a cube; the value is the time [s], the reference
  90. A cube is the worst case for factors.
"""

from collections.abc import Callable
from time import perf_counter

import numpy as np
from common import block_of

import rigidfx as rf

Case = Callable[[bool], list[tuple[str, float, float]]]

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.0, rho=8000.0)
FORK = 356.8021, 558.1005, 1577.6497, 2278.7571  # Hz
SECONDS = 90.0  # for six modes of 200 000 unknowns on one core


def beam(beta: float, thick: float) -> float:
    """Frequency of a beam of length 1 and square section [Hz]."""
    return beta**2 / (2 * np.pi) * thick * np.sqrt(2e11 / 8000.0 / 12)


def bars(short: bool) -> list[tuple[str, float, float]]:
    """A free and a clamped bar, a hundred times as long as thick."""
    thick = 0.01
    bar = rf.box((0, 0, 0), (1, thick, thick), (20 if short else 60, 1, 1))
    out = []
    for name, beta, holds in (
        ("free bar", 4.730041, []),
        ("clamped bar", 1.875104, [rf.Fixed("x0")]),
    ):
        scene = rf.Scene(bar, STEEL, holds, order=2, mass="consistent")
        out.append((name, float(rf.modes(scene, 1).frequencies[0]), beam(beta, thick)))
    return out


def plate(short: bool) -> list[tuple[str, float, float]]:
    """A clamped plate, a hundred times as wide as thick."""
    n, thick, nu = (16 if short else 32), 0.01, 0.3
    square = rf.box((0, 0, 0), (1, 1, thick), (n, n, 1))
    metal = rf.StVenantKirchhoff(E=2e11, nu=nu, rho=8000.0)
    scene = rf.Scene(square, metal, [rf.Fixed(s) for s in ("x0", "x1", "y0", "y1")], order=2)
    stiffness = np.sqrt(2e11 * thick**2 / (12 * (1 - nu**2) * 8000.0))
    exact = 35.985 * stiffness / (2 * np.pi)
    return [("plate", float(rf.modes(scene, 1).frequencies[0]), exact)]


def fork_modes(prong: int, bend: int, across: int) -> np.ndarray:
    """The first four frequencies of a free fork [Hz], by cells of a prong and the half circle."""
    long, radius, thick = 0.08, 0.01, 0.004
    half = np.pi * radius
    count = 2 * prong + bend
    cells = [0, prong, prong + bend, count]

    def place(x: np.ndarray) -> np.ndarray:
        s = np.interp(count * x[0], cells, np.cumsum([0.0, long, half, long]))
        angle = np.clip((s - long) / radius, 0.0, np.pi)
        r = radius + thick * (x[1] - 0.5)
        up = np.where(s < long, long - s, np.where(s > long + half, s - long - half, 0.0))
        return np.stack([-r * np.cos(angle), up - r * np.sin(angle), thick * x[2]])

    fork = block_of((count, across, across), place)
    metal = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=8000.0)
    scene = rf.Scene(fork, metal, [], order=2, mass="consistent")
    return rf.modes(scene, 4).frequencies[:4]


def fork(short: bool) -> list[tuple[str, float, float]]:
    """Four modes of a free tuning fork."""
    found = fork_modes(20, 20, 2) if short else fork_modes(24, 96, 6)
    return [
        (f"tuning fork, mode {k}", float(f), exact)
        for k, (f, exact) in enumerate(zip(found, FORK, strict=True), start=1)
    ]


def hinged_bar(pull: float, cells: int) -> tuple[float, float]:
    """First frequency of a hinged bar under a pull [N], and the exact one [Hz]."""
    long, thick = 1.0, 0.01
    bar = rf.box((0, 0, 0), (long, thick, thick), (cells, 1, 1))
    soft = rf.StVenantKirchhoff(E=1e9, nu=0.0, rho=1000.0)
    hinges = [rf.Fixed("x0", "yz"), rf.Fixed("x1", "yz"), rf.Spring("x0", (1.0, 0.0, 0.0))]
    ends = (("x0", -pull), ("x1", pull))
    loads = [rf.Traction(end, (N / thick**2, 0.0, 0.0)) for end, N in ends]
    scene = rf.Scene(bar, soft, [*hinges, *loads], order=2, mass="consistent")
    *_, pulled = rf.static(scene, 2)
    found = rf.modes(scene, 4, about=pulled)
    across = np.flatnonzero(found.effective_mass[:, 0] < 1e-6)[0]
    k, mass = np.pi / long, 1000.0 * thick**2
    square = k**2 * (pull + k**2 * 1e9 * thick**4 / 12) / mass
    return float(found.frequencies[across]), float(np.sqrt(square) / (2 * np.pi))


def string(short: bool) -> list[tuple[str, float, float]]:
    """A hinged bar that is pulled: its stresses hold it more than its bending does."""
    return [("pulled string", *hinged_bar(50.0, 20 if short else 60))]


def large(short: bool) -> list[tuple[str, float, float]]:
    """Times for six modes [s]."""
    out = []
    for name, size, cells in (
        ("plate", (1, 1, 0.05), (20, 20, 4) if short else (115, 115, 4)),
        ("cube", (1, 1, 1), (8, 8, 8) if short else (40, 40, 40)),
    ):
        scene = rf.Scene(rf.box((0, 0, 0), size, cells), STEEL, [rf.Fixed("x0")])
        began = perf_counter()
        rf.modes(scene, 6)
        unknowns = 3 * scene.space.dofmap.index_map.size_global
        title = f"{name} of {unknowns} unknowns, seconds for six modes"
        out.append((title, perf_counter() - began, SECONDS))
    return out


CASES: dict[str, tuple[Case, float | None]] = {  # and the relative error that is allowed
    "bars": (bars, 1e-3),
    "plate": (plate, 0.02),
    "tuning fork": (fork, 1e-4),
    "pulled string": (string, 1e-3),
    "200 000 unknowns": (large, None),
}

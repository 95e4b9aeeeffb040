"""Shapes: very thin, very slender, badly meshed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from common import hexahedra, on_first_rank

import rigidfx as rf

from .case import ANY, History, Run, case, near, release_at

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
SPIN = rf.InitialVelocity(angular=(0.2, 0.3, 1.0))


@case("shape", "a plate a thousand times as wide as thick, bent by a load")
def thin_plate(short: bool) -> Iterator[Run]:
    """H to rounding, which thinness magnifies: of u ε u/t is left in the strains, and with strains
    e of 1e-4 that is ε (u/t) e E V/H = 6e-7 of the energy. The static deflection is that of a beam
    (ν = 0) within 2 %."""
    E, t, force = 2.1e11, 1e-3, 0.01  # Pa, m, N

    def deflects(history: History) -> str:
        u = history.probe("edge")[0, 2]
        return near("the deflection", float(u), force / (3 * E * t**3 / 12), 0.02)

    load = rf.NodalForce("x1", (0.0, 0.0, force))
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 1, t), (6, 2, 1) if short else (12, 6, 1)),
        rf.StVenantKirchhoff(E=E, nu=0.0, rho=7850.0),
        [rf.Fixed("x0"), rf.Preload([load])],
        order=2,
        probes={"edge": (1.0, 0.5, 0.0)},
    )
    options = {"momentum": None, "energy": 1e-6, "check": deflects}
    t_end = 0.5 if short else 5.0
    yield Run("flexible", scene, 0.05, t_end, **options)
    adaptive = rf.StrainRate(ANY, 0.1, release=release_at(0.3), patience=1)
    yield Run("adaptive", scene, 0.05, t_end, adaptive, **options)


@case("shape", "a needle a thousand times as long as thick, tumbling and rolling")
def needle(short: bool) -> Iterator[Run]:
    """H, L and J to 1e-8: u in double precision leaves forces of ε E/(ρ v²), 1e-7 of those of the
    motion, but these are stresses: they move nothing as a whole, and a step keeps what linear
    solves keep. A solve that is loose turns the needle about its own axis, where its inertia is
    1e-6 of that about the others, and of the quadratic error of that Newton does not recover: the
    first solve that does so may cost a step some 1e-9 and some iterations."""
    E, rho = 2.1e11, 7850.0  # Pa, kg/m³
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 1e-3, 1e-3), (6, 1, 1) if short else (20, 1, 1)),
        rf.StVenantKirchhoff(E=E, nu=0.3, rho=rho),
        [rf.InitialVelocity(angular=(5.0, 0.5, 1.0))],
        order=2,
    )
    t_end, dt = (1.0 if short else 10.0), 0.02
    # Such a step takes some iterations more, how many depends on the last digits of the kernels.
    bounds = {"energy": 1e-8, "momentum": 1e-8, "tangents": 12}
    yield Run("flexible", scene, dt, t_end, **bounds)
    adaptive = rf.StrainRate(ANY, 0.1, release=release_at(0.5), patience=1)
    yield Run("adaptive", scene, dt, t_end, adaptive, **bounds)


def _distorted(cells: tuple[int, int, int], cell: str, move) -> rf.Domain:
    """A bar of unit cells whose corners `move` displaces, and does so alike on any ranks."""
    grid, connected = hexahedra(*(np.arange(n + 1.0) for n in cells))
    points = move(grid.reshape(*np.add(cells, 1), 3)).reshape(-1, 3)
    if cell == "tetrahedron":
        six = [(0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (0, 3, 2, 7), (0, 6, 4, 7), (0, 2, 6, 7)]
        connected = np.concatenate([connected[:, list(four)] for four in six])
    return on_first_rank(points, connected, cell)


@case("shape", "hexahedra whose corners are moved by 40 % of their edge at random")
def distorted_hexahedra(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance: conservation needs no good cells."""
    random = np.random.default_rng(3)

    def move(grid: np.ndarray) -> np.ndarray:
        return grid + random.uniform(-0.4, 0.4, grid.shape) / np.sqrt(3)

    domain = _distorted((4, 2, 2) if short else (8, 3, 3), "hexahedron", move)
    scene = rf.Scene(domain, MATERIAL, [SPIN])
    t_end = 4.0 if short else 40.0
    yield Run("flexible", scene, 0.1, t_end, energy=1e-11, momentum=1e-11)
    adaptive = rf.StrainRate(ANY, 1.0, release=release_at(2.0), patience=1)
    yield Run("adaptive", scene, 0.1, t_end, adaptive, energy=1e-11, momentum=1e-11)
    enhanced = rf.Scene(domain, MATERIAL, [SPIN], element="enhanced")
    yield Run("enhanced", enhanced, 0.1, t_end, adaptive, energy=1e-11, momentum=1e-11)
    top = domain.with_facets("top", lambda X: X[2] > (1.5 if short else 2.5))
    assumed = rf.Scene(top, MATERIAL, [SPIN], element=rf.AssumedStrains("top"))
    yield Run("assumed", assumed, 0.1, t_end, adaptive, energy=1e-11, momentum=1e-11)


@case("shape", "tetrahedra of a thousandth of their neighbours' volume")
def slivers(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance and to rounding in cells 1e3 times too stiff."""

    def move(grid: np.ndarray) -> np.ndarray:
        grid = grid.copy()
        grid[1, 1, 1] += (0.999, 0.0, 0.0)  # close to the next node, so that cells between go flat
        return grid

    domain = _distorted((4, 2, 2) if short else (8, 2, 2), "tetrahedron", move)
    scene = rf.Scene(domain, MATERIAL, [SPIN])
    t_end = 4.0 if short else 40.0
    yield Run("flexible", scene, 0.1, t_end, energy=1e-10, momentum=1e-10)
    adaptive = rf.StrainRate(ANY, 1.0, release=release_at(2.0), patience=1)
    yield Run("adaptive", scene, 0.1, t_end, adaptive, energy=1e-10, momentum=1e-10)

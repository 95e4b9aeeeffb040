"""Extremes of materials, shapes and units: soft beside stiff, thin, slender, badly meshed."""

from collections.abc import Iterator

import numpy as np
from common import hexahedra, on_first_rank

import rigidfx as rf

from .case import ANY, History, Run, between, both, case, near, release_at

SOFT = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
SPIN = rf.InitialVelocity(angular=(0.2, 0.3, 1.0))
RELEASED = rf.StrainRate(ANY, 1.0, release=release_at(2.0), patience=1)


def two_halves(short: bool, stiff: rf.Material, soft: rf.Material, *effects: rf.effects.Effect):
    """A bar of 8 m, the left half of one material, the right half of another."""
    domain = rf.box((0, 0, 0), (8, 2, 2), (4, 1, 1) if short else (8, 2, 2))
    domain = domain.with_cells("stiff", between(0, 4)).with_cells("soft", between(4, 8))
    return rf.Scene(domain, {"stiff": stiff, "soft": soft}, effects)


@case("material", "E differs by 1e8 and ρ by 1e6 between two halves")
def stiff_and_heavy_beside_soft_and_light(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance, n 1e-12, and to rounding in the stiff half.

    u in double precision leaves forces of ε E₁/(ρ₂ v²) relative to those of the soft half, where
    that carries the motion: 1e-5 at worst, of which a step keeps the part that does work, 1e-10.
    Krylov iterations have to end by the residual of the system itself: by the preconditioned one
    momenta were off by 1e-2 in 200 steps.
    """
    soft = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=1.0)
    for way, rho in (("heavy is stiff", 1e6), ("heavy is soft", 1e-6)):
        stiff = rf.StVenantKirchhoff(E=1e12, nu=0.3, rho=rho)
        t_end = 2.0 if short else 20.0
        bound = t_end / 0.1 * (1e-10 if rho < 1 else 1e-12) + 1e-9
        options = {"energy": bound, "momentum": bound}
        scene = two_halves(short, stiff, soft, SPIN)
        adaptive = rf.StrainRate(0.0, 0.5, tolerances={"stiff": ANY},
                                 release=release_at(1.5), patience=1)  # fmt: skip
        yield from both(scene, 0.1, t_end, adaptive, way, **options)


@case("material", "E differs by 1e8, and the stiff half is rigid")
def stiff_half_as_a_body(short: bool) -> Iterator[Run]:
    """A body knows no stiffness: drifts and iterations as without the ratio."""
    soft = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    for way, rho in (("equally heavy", 10.0), ("1e6 times as light", 1e-5)):
        stiff = rf.StVenantKirchhoff(E=1e12, nu=0.3, rho=rho)
        scene = two_halves(short, stiff, soft, SPIN, rf.Rigid("stiff"))
        yield Run(f"{way}, named rigid", scene, 0.1, 2.0 if short else 20.0, tangents=5)


LENGTH, FORCE = 10.0, 10.0  # m, N


def _deflection(E: float, nu: float) -> float:
    """Tip deflection of a beam of 1 m × 1 m with bending and shear [m]."""
    shear = FORCE * LENGTH / (5 / 6 * E / (2 * (1 + nu)))
    return FORCE * LENGTH**3 / (3 * E / 12) + shear


@case("material", "ν = 0.4999: cells that cannot change their volume may hardly bend")
def nearly_incompressible(short: bool) -> Iterator[Run]:
    """H to Newton's tolerance; the deflection is that of a beam within 10 % (coarse cells).

    Cells of second order give it; those of first order lock, and a scene warns of them. Where the
    linear systems are too badly conditioned for Newton to end, steps are cut.
    """
    E, nu = 1e6, 0.4999

    def deflects(history: History) -> str:
        u = history.probe("tip")[0, 2]
        return near("locks: the static deflection", float(u), _deflection(E, nu), 0.1)

    for order, way, warns in ((2, "second order", ""), (1, "first order", "order=2")):

        def scene(order: int = order) -> rf.Scene:
            return rf.Scene(
                rf.box((0, 0, 0), (LENGTH, 1, 1), (10, 1, 1) if short else (20, 2, 2)),
                rf.StVenantKirchhoff(E=E, nu=nu, rho=1000.0),
                [rf.Fixed("x0"), rf.Preload([rf.NodalForce("x1", (0.0, 0.0, FORCE))])],
                order=order,
                probes={"tip": (LENGTH, 0.5, 0.5)},
            )

        yield Run(way, scene, 0.1, 1.0 if short else 10.0, momentum=None, check=deflects,
                  warns=warns, known="locks" if order == 1 else "",
                  why="first-order cells; take order=2", cuts=10)  # fmt: skip


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
    adaptive = rf.StrainRate(ANY, 0.1, release=release_at(0.3), patience=1)
    yield from both(scene, 0.05, t_end, adaptive, **options)


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
    adaptive = rf.StrainRate(ANY, 0.1, release=release_at(0.5), patience=1)
    yield from both(scene, dt, t_end, adaptive, **bounds)


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
    t_end, bounds = 4.0 if short else 40.0, {"energy": 1e-11, "momentum": 1e-11}
    yield from both(rf.Scene(domain, SOFT, [SPIN]), 0.1, t_end, RELEASED, **bounds)
    enhanced = rf.Scene(domain, SOFT, [SPIN], element="enhanced")
    yield Run("enhanced", enhanced, 0.1, t_end, RELEASED, **bounds)
    top = domain.with_facets("top", lambda X: X[2] > (1.5 if short else 2.5))
    assumed = rf.Scene(top, SOFT, [SPIN], element=rf.AssumedStrains("top"))
    yield Run("assumed", assumed, 0.1, t_end, RELEASED, **bounds)


@case("shape", "tetrahedra of a thousandth of their neighbours' volume")
def slivers(short: bool) -> Iterator[Run]:
    """H, L and J to Newton's tolerance and to rounding in cells 1e3 times too stiff."""

    def move(grid: np.ndarray) -> np.ndarray:
        grid = grid.copy()
        grid[1, 1, 1] += (0.999, 0.0, 0.0)  # close to the next node, so that cells between go flat
        return grid

    domain = _distorted((4, 2, 2) if short else (8, 2, 2), "tetrahedron", move)
    t_end, bounds = 4.0 if short else 40.0, {"energy": 1e-10, "momentum": 1e-10}
    yield from both(rf.Scene(domain, SOFT, [SPIN]), 0.1, t_end, RELEASED, **bounds)


SYSTEMS = {  # one metre, one kilogram and one second in the units of each
    "SI": (1.0, 1.0, 1.0),
    "mm, t, s": (1e3, 1e-3, 1.0),
    "powers of two": (2.0**20, 2.0**-13, 2.0**5),
}


@case("units", "the same motion in mm, t and s, and in units 2²⁰, 2⁻¹³ and 2⁵ times those of SI")
def other_units(short: bool) -> Iterator[Run]:
    """Displacements and iterations are those in SI: to rounding, which steps magnify, 1e-10.

    Units that are powers of two change no digit: 1e-13.
    """
    t_end = 2.0 if short else 20.0
    for kind in ("flexible", "half rigid", "adaptive"):
        reference: list[History] = []
        for units, (length, mass, time) in SYSTEMS.items():
            domain = rf.box((0, 0, 0), np.array([8, 2, 2]) * length, (4, 1, 1))
            domain = domain.with_cells("left", between(0, 4 * length))
            pressure = mass / length / time**2
            effects = [
                rf.InitialVelocity(angular=(1.5 / time, 0.3 / time, 5.0 / time)),
                rf.Traction("x1", (0.0, 50.0 * pressure, 0.0), until=0.5 * time),
                *([rf.Rigid("left")] if kind == "half rigid" else []),
            ]
            scene = rf.Scene(
                domain,
                rf.StVenantKirchhoff(rho=mass / length**3, E=3e4 * pressure, nu=0.3),
                effects,
                probes={"tip": (8 * length, 2 * length, 2 * length)},
            )
            adaptive = rf.StrainRate(0.0, 0.5 * time, tolerances={"left": ANY / time},
                                     release=release_at(1.5 * time))  # fmt: skip

            def is_the_same(
                history: History,
                length: float = length,
                units: str = units,
                reference: list[History] = reference,
            ) -> str:
                reference.append(history)
                u, v = (h.probe("tip") for h in (reference[0], history))
                error = np.abs(v / length - u).max() / np.abs(u).max()
                extra = abs(sum(history.iterations) - sum(reference[0].iterations))
                bound = 1e-10 if units == "mm, t, s" else 1e-13
                if error > bound:
                    return f"the tip is off by {error:.1e}"
                most = max(2, sum(history.iterations) // 200)  # where rounding decides to stop
                return f"{extra} more or fewer iterations" if extra > most else ""

            yield Run(f"{kind}, {units}", scene, 0.05 * time, t_end * time,
                      adaptive if kind == "adaptive" else None, momentum=None,
                      check=is_the_same)  # fmt: skip

"""Impacts with known answers: waves in a bar, bounces, Hertz, friction, and energy through it all.

    ./fenicsx python3 demos/benchmarks/impact.py
    ./fenicsx python3 demos/benchmarks/impact.py --short --only bar

`summary.json` has, of the bar that hits a wall, `energy_drift`, `force_error`, `duration_error` and
`rebound_error`, relative to the theory of plane waves in one dimension (force ρ c v S for 2 L/c,
rebound at v; lateral motion is blocked), and the numbers of each case in `cases`. Beside the bar
stands the same bar in one dimension, by Newmark's method with the same penalty, which makes or
loses energy at each opening and closing.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from bench import Parser, conclude

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
FLOOR = rf.Plane((0, 0, 0), (0, 0, 1))
OBSTACLES = {
    "plane": FLOOR,
    "sphere": rf.Sphere((0.2, 0.1, -0.5), 0.5),
    "in a sphere": rf.Sphere((0.2, 0.1, 0.1), 0.29, inside=True),
    "cylinder": rf.Cylinder((0.2, 0.1, -0.5), 0.5, axis=(0, 1, 0)),
}
PARTS = {"flexible": [], "rigid": [rf.Rigid()], "mixed": [rf.Rigid("part")]}

parser = Parser(__file__, __doc__.splitlines()[0], "fewer cells, steps and bounces")
parser.add_argument("--only", default="", help="cases whose names contain this")


def drift(reports: list[rf.Report]) -> float:
    """How far the balance of energy is off, relative to the largest energy."""
    expected = worst = 0.0
    for r in reports[1:]:
        expected += r.work_of_loads + r.work_of_supports - sum(r.dissipated.values())
        expected += r.impact.energy if r.impact else 0.0
        worst = max(worst, abs(r.energy - reports[0].energy - expected))
    return worst / max(r.energy for r in reports)


def block(*effects: rf.Effect, above: float = 0.02, mass: str = "lumped") -> rf.Scene:
    """A block over the floor, all of its boundary named."""
    domain = rf.box((0, 0, above), (0.4, 0.2, above + 0.2), (4, 2, 2))
    domain = domain.with_cells("part", lambda x: x[0] <= 0.2 + 1e-9)
    domain = domain.with_cells("all", lambda x: x[0] > -1)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    return rf.Scene(domain, SOFT, effects, mass=mass)


# A bar and a wall -------------------------------------------------------------------------------


def bar_against_wall(short: bool) -> dict[str, float]:
    """200 cells at v = c/500: errors of force, duration and rebound, and Newmark's energy."""
    n, L, S, rho, nu, E = 200, 1.0, 0.01**2, 1.0, 0.3, 1.0
    c = float(np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / rho))
    v, dt = c / 500, L / n / c * (1.0 if short else 0.5)
    bar = rf.box((0, 0, 0), (L, 0.01, 0.01), (n, 1, 1)).with_cells("all", lambda x: x[0] > -1)
    gap = 0.05 * v * L / c
    bar_ahead = rf.Plane((-gap, 0, 0), (1, 0, 0))
    wall = rf.Contact("x0", against=bar_ahead, title="wall")
    effects = [wall, rf.Fixed("all", "yz"), rf.InitialVelocity(linear=(-v, 0, 0))]
    scene = rf.Scene(bar, rf.StVenantKirchhoff(rho=rho, E=E, nu=nu), effects)
    reports = list(rf.simulate(scene, dt, 2.4 * L / c))
    force = np.array([r.touches["wall"].force[0] for r in reports[1:]])
    t = np.array([r.t for r in reports[1:]])
    steps = np.array([r.dt for r in reports[1:]])
    pressed = np.flatnonzero(force > 0)
    duration = t[pressed[-1]] - t[pressed[0]] + steps[pressed[0]]
    begin = t[pressed[0]] - steps[pressed[0]]
    middle = (t > begin + 0.2 * duration) & (t < begin + 0.8 * duration)
    known = rho * c * v * S
    rebound = reports[-1].linear_momentum[0] / (rho * L * S)
    k = 5 * rho * c * c * n / L * S  # the default, of a layer of cells
    out = {
        "energy_drift": drift(reports),
        "force_error": abs(force[middle].mean() / known - 1),
        "duration_error": abs(duration * c / (2 * L) - 1),
        "rebound_error": abs(rebound / v - 1),
    }
    for way in ("secant", "newmark"):
        bar_1d = one_dimension(n, L, rho * S, rho * c * c * S, k, v, gap, dt, 2.4 * L / c, way)
        out[f"energy_of_{way}_in_one_dimension"] = bar_1d
    return out


def one_dimension(
    n: int,
    L: float,
    m: float,
    EA: float,
    k: float,
    v: float,
    gap: float,
    dt: float,
    t_end: float,
    way: str,
) -> float:
    """Largest error of the energy of a linear bar in one dimension with a penalty, relative.

    Args:
        n: Cells.
        L: Length [m].
        m: Mass of a length [kg/m].
        EA: Stiffness [N].
        k: Penalty [N/m].
        v: Speed [m/s].
        gap: Gap at the start [m].
        dt: Δt [s].
        t_end: End [s].
        way: "secant", or "newmark" (β = ¼, γ = ½) with the force of the end of the step.
    """
    M = np.full(n + 1, m * L / n)
    M[[0, -1]] /= 2
    K = 2 * np.eye(n + 1) - np.eye(n + 1, k=1) - np.eye(n + 1, k=-1)
    K[0, 0] = K[-1, -1] = 1
    K *= EA * n / L
    u, w = np.zeros(n + 1), np.full(n + 1, -v)
    a = np.zeros(n + 1)

    def energy() -> float:
        return 0.5 * (M @ w**2 + u @ K @ u + k * min(u[0] + gap, 0.0) ** 2)

    first, worst = energy(), 0.0
    if way == "secant":  # M (2 d/dt - 2 w)/dt + K (u + d/2) + [U] = 0
        A = np.linalg.inv(2 * np.diag(M) / dt**2 + K / 2)
        rest = A @ (2 * M * w / dt - K @ u)
    else:
        A = np.linalg.inv(4 * np.diag(M) / dt**2 + K)
    for _ in range(round(t_end / dt)):
        if way == "secant":
            rest = A @ (2 * M * w / dt - K @ u)
            g0 = u[0] + gap
        else:  # M a₁ + K u₁ + k g₋ = 0, a₁ = 4 (d/dt - w)/dt - a
            rest = A @ (M * (4 * w / dt + a) - K @ u)
            g0 = np.inf
        d0 = contact_increment(rest[0], A[0, 0], u[0] + gap, g0, k)
        d = rest + A[:, 0] * (d0 - rest[0]) / A[0, 0]
        if way == "secant":
            w = 2 * d / dt - w
        else:
            a_new = 4 * (d / dt - w) / dt - a
            w = w + dt / 2 * (a + a_new)
            a = a_new
        u = u + d
        worst = max(worst, abs(energy() - first))
    return float(worst / first)


def contact_increment(free: float, flexibility: float, gap: float, g0: float, k: float) -> float:
    """The increment of a node that a penalty stops, by bisection: its residual rises with it."""

    def residual(d: float) -> float:
        g1 = gap + d
        if not np.isfinite(g0):
            force = k * min(g1, 0.0)
        elif (g0 < 0) == (g1 < 0):
            force = 0.5 * k * (g0 + g1) if g0 < 0 else 0.0
        else:
            force = 0.5 * k * (min(g1, 0) ** 2 - min(g0, 0) ** 2) / (g1 - g0)
        return d - free + flexibility * force

    low, high = free, free
    reach = max(abs(free), abs(gap), abs(flexibility * k * gap)) + 1e-300
    while residual(high) < 0:
        high += reach
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if residual(middle) < 0 else (low, middle)
    return 0.5 * (low + high)


# Two bars -----------------------------------------------------------------------------------------


def bars(short: bool) -> dict[str, float]:
    """A bar hits an equal one, and one of the same wave speed and three times the impedance.

    Then it has (Z₁ - Z₂)/(Z₁ + Z₂) of its speed, and the other 2 Z₁/(Z₁ + Z₂).
    """
    out, n, E, nu, v = {}, 60 if short else 200, 1.0, 0.3, 2e-3
    c, apart = float(np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)))), 2e-4
    worst = 0.0
    for name, ratio in (("equal", 1.0), ("different", 3.0)):
        domain = two_bars(n, apart)
        soft, stiff = (rf.StVenantKirchhoff(rho=k, E=k * E, nu=nu) for k in (1.0, ratio))

        def thrown(x: np.ndarray) -> np.ndarray:
            return np.where(x[0] > 1 + apart / 2, 0.0, v) * np.array([[1.0], [0.0], [0.0]])

        held = rf.Fixed("first", "yz"), rf.Fixed("second", "yz")
        contact = rf.Contact("end", against="begin")
        effects = [contact, *held, rf.InitialVelocity(function=thrown)]
        scene = rf.Scene(domain, {"first": soft, "second": stiff}, effects)
        reports = list(rf.simulate(scene, 1 / n / c, 2.6 / c))
        last, first = reports[-1], reports[0]
        X, m = scene.space.tabulate_dof_coordinates()[:, 0], scene.nodal_mass
        speed = last.state.v.x.array.reshape(-1, 3)[:, 0]
        here = np.arange(X.size) < scene.owned_nodes
        own = [here & (1 + 0.1 * apart > X), here & (1 + 0.1 * apart < X)]
        of = [scene.sum((m * speed)[k].sum()) / scene.sum(m[k].sum()) / v for k in own]
        known = (1 - ratio) / (1 + ratio), 2 / (1 + ratio)
        out[f"{name}_speed_error"] = float(np.abs(np.subtract(of, known)).max())
        change = last.linear_momentum - first.linear_momentum
        worst = max(worst, float(np.abs(change).max() / first.momentum_scale))
        out["energy_drift"] = max(out.get("energy_drift", 0.0), drift(reports))
    return {**out, "linear_momentum_drift": worst}


def two_bars(n: int, apart: float) -> rf.Domain:
    """Two bars of a metre in a row, of so many cells each, which share no node."""
    from mpi4py import MPI

    x = np.linspace(0, 1, n + 1)
    section = np.array([(y, z) for y in (0, 0.01) for z in (0, 0.01)])
    points = [(a, *yz) for start in (0, 1 + apart) for a in start + x for yz in section]
    corners = np.array([0, 4, 2, 6, 1, 5, 3, 7])
    firsts = [4 * (i + k * (n + 1)) for k in range(2) for i in range(n)]
    cells = np.array(firsts)[:, None] + corners
    mine = slice(0 if MPI.COMM_WORLD.rank else None)
    middle = 1 + apart / 2
    domain = rf.from_arrays(np.array(points)[mine], cells[mine])
    domain = domain.with_cells("first", lambda x: x[0] < middle)
    domain = domain.with_cells("second", lambda x: x[0] > middle)
    domain = domain.with_facets("end", lambda x: np.abs(x[0] - 1) < 0.1 * apart)
    return domain.with_facets("begin", lambda x: np.abs(x[0] - 1 - apart) < 0.1 * apart)


# Energy through contact -------------------------------------------------------------------------


def energy_in_contact(short: bool) -> dict[str, float]:
    """Energy of a block that rattles, per obstacle, division and mass: the worst of all."""
    worst, fewest, wanted = 0.0, 10**9, 100 if short else 1000
    thrown = rf.InitialVelocity(linear=(0.3, 0, -0.5), angular=(1, 2, 0.5))
    for obstacle in OBSTACLES.values():
        for parts in PARTS.values():
            for mass in ("lumped", "consistent"):
                contact = rf.Contact("skin", against=obstacle, stiffness=2e6)
                gravity = rf.Gravity((0, 0, -30.0))
                scene = block(contact, thrown, gravity, *parts, above=0.01, mass=mass)
                reports, touching = [], 0
                for r in rf.simulate(scene, 1e-3, 20.0):
                    reports.append(r)
                    touching += any(touch.energy > 0 for touch in r.touches.values())
                    if touching >= wanted or r.step >= 3 * wanted:
                        break
                worst, fewest = max(worst, drift(reports)), min(fewest, touching)
    return {"energy_drift": worst, "fewest_steps_in_contact": fewest}


def bounces(short: bool) -> dict[str, float]:
    """A rigid block falls flat again and again: error of the height it regains, relative."""
    g, height, wanted = 10.0, 0.05, 20 if short else 100
    contact = rf.Contact("skin", against=FLOOR)
    # So large an inertia that rounding does not make it rock.
    heavy = rf.Rigid("all", mass=16.0, inertia=1e9 * np.eye(3))
    scene = block(contact, rf.Gravity((0, 0, -g)), heavy, above=height)
    mass, found, worst, rises = 0.4 * 0.2 * 0.2 * 1000.0, 0, 0.0, False
    for r in rf.simulate(scene, 2e-3, 1e3):
        v = r.linear_momentum[2] / mass
        if rises and v <= 0:
            found += 1
            top = r.rigid.r[0, 2] - 0.1 + v * v / (2 * g)  # at the instant between two steps
            worst = max(worst, abs(top / height - 1))
        rises = v > 0
        if found == wanted:
            break
    return {"bounces": found, "height_error": worst}


# Hertz ------------------------------------------------------------------------------------------


def hertz(short: bool) -> dict[str, float]:
    """A rigid sphere slowly pressed into a quarter of a block: force and approach."""
    R, nu, E, depth, rho = 1.0, 0.3, 1e6, 4e-4, 1000.0
    a = float(np.sqrt(R * depth))
    n, growth, first = (12, 1.45, a / 4) if short else (16, 1.33, a / 7)
    lines = np.r_[0.0, np.cumsum(first * growth ** np.arange(n))]
    domain = graded(lines)
    fall, calm = 0.2, 0.1  # s, slow against L/c = 0.03 s
    ball = rf.Sphere((0, 0, R), R, path=lambda t: (0, 0, -depth * min(t / fall, 1.0)))
    contact = rf.Contact("top", against=ball, title="ball")
    held = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("bottom")]
    effects = [contact, *held, rf.MassDamping(200.0)]
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=E, nu=nu, rho=rho), effects)
    *_, last = rf.simulate(scene, 0.01, fall + calm)
    known = 4 / 3 * E / (1 - nu**2) * np.sqrt(R) * depth**1.5
    force = -4 * last.touches["ball"].force[2]
    return {"force_error": abs(force / known - 1), "penetration_by_approach":
            last.touches["ball"].penetration / depth}  # fmt: skip


def graded(lines: np.ndarray) -> rf.Domain:
    """A quarter of a block below z = 0; cells grow away from the origin."""
    n = lines.size
    x, y, z = np.meshgrid(lines, lines, -lines[::-1], indexing="ij")
    points = np.stack([x.reshape(-1), y.reshape(-1), z.reshape(-1)], axis=1)
    i, j, k = np.meshgrid(*[np.arange(n - 1)] * 3, indexing="ij")
    corner = (i * n * n + j * n + k).reshape(-1)
    offsets = [a * n * n + b * n + c for c in (0, 1) for b in (0, 1) for a in (0, 1)]
    cells = corner[:, None] + np.array(offsets)
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank:
        points, cells = points[:0], cells[:0]
    domain, far = rf.from_arrays(points, cells), -lines[-1]
    faces = {
        "top": lambda x: np.isclose(x[2], 0.0),
        "bottom": lambda x: np.isclose(x[2], far),
        "x0": lambda x: np.isclose(x[0], 0.0),
        "y0": lambda x: np.isclose(x[1], 0.0),
    }
    for name, marker in faces.items():
        domain = domain.with_facets(name, marker)
    return domain


# Friction ---------------------------------------------------------------------------------------


def friction(short: bool) -> dict[str, float]:
    """Way of a block that slides to rest, and creep of one on a slope."""
    mu, g, v, k, creep = 0.3, 10.0, 0.5, 1e8, 1e-4
    contact = rf.Contact("z0", against=FLOOR, stiffness=k, friction=mu, creep=creep)
    effects = [contact, rf.Rigid(), rf.InitialVelocity(linear=(v, 0, 0)), rf.Gravity((0, 0, -g))]
    slides = list(rf.simulate(block(*effects, above=-200.0 * g / k), 1e-3, 0.3))
    way = slides[-1].rigid.r[0, 0] - 0.2
    slope = 0.25
    down = g * np.array([np.sin(np.arctan(slope)), 0, -np.cos(np.arctan(slope))])
    effects = [contact, rf.Rigid(), rf.Gravity(tuple(down))]
    creeps = list(rf.simulate(block(*effects, above=200.0 * down[2] / k), 1e-3, 0.2))
    fastest = creep * slope / np.sqrt(mu**2 - slope**2)
    begin, end = creeps[10], creeps[-1]  # velocities at the ends of steps swing about the mean
    speed = (end.rigid.r - begin.rigid.r)[0, 0] / (end.t - begin.t)
    gains = [b.energy - a.energy - b.work_of_loads for a, b in pairwise(slides)]
    return {
        "way_error": abs(way / (v * v / (2 * mu * g)) - 1),
        "creep_by_theory": speed / fastest,
        "largest_gain_of_energy": max(gains) / slides[0].energy,
        "energy_drift": max(drift(slides), drift(creeps)),
    }


CASES: dict[str, Callable[[bool], dict[str, float]]] = {
    "bar": bar_against_wall,
    "two bars": bars,
    "energy": energy_in_contact,
    "bounces": bounces,
    "hertz": hertz,
    "friction": friction,
}


def main() -> None:
    """Run the cases and judge them."""
    options = parser.read()
    chosen = {name: case for name, case in CASES.items() if options.only in name}
    cases = {name: case(options.short) for name, case in chosen.items()}
    bar = cases.get("bar", {})
    conclude(options.out, {**bar, "cases": cases})
    for name, found in cases.items():
        assert found.get("energy_drift", 0.0) <= 1e-11, name
    if bar:
        assert bar["force_error"] <= 0.03
        assert max(bar["duration_error"], bar["rebound_error"]) <= 0.02
    if "two bars" in cases:
        assert cases["two bars"]["equal_speed_error"] <= 0.03
        assert cases["two bars"]["different_speed_error"] <= 0.03
        assert cases["two bars"]["linear_momentum_drift"] <= 1e-12
    if "bounces" in cases:
        assert cases["bounces"]["height_error"] <= 1e-9
    if "hertz" in cases:
        assert cases["hertz"]["force_error"] <= 0.05
    if "friction" in cases:
        assert cases["friction"]["way_error"] <= 0.01
        assert cases["friction"]["creep_by_theory"] <= 1.01
        assert cases["friction"]["largest_gain_of_energy"] <= 1e-12


if __name__ == "__main__":
    main()

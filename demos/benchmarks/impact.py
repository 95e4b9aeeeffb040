"""Impacts with known answers: waves in a bar, bounces, Hertz, friction, and energy through it all.

    ./fenicsx python3 demos/benchmarks/impact.py
    ./fenicsx python3 demos/benchmarks/impact.py --short --only wall

`summary.json` has, of the bar that hits a wall, `energy_drift`, `force_error`, `duration_error` and
`rebound_error`, relative to the theory of plane waves in one dimension (force ρ c v S for 2 L/c,
rebound at v; lateral motion is blocked), and the numbers of each case in `cases`.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from bench import Parser, chosen, conclude
from common import Balance, block_of, boxes, energy_drift
from petsc4py import PETSc

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
FLOOR = rf.Plane((0, 0, 0), (0, 0, 1))


def block(
    *effects: rf.effects.Effect,
    above: float = 0.02,
    cells: tuple[int, int, int] = (4, 2, 2),
    cell: str = "hexahedron",
    material: rf.Material = SOFT,
    **how: Any,
) -> rf.Scene:
    """A block over the floor, all of its boundary named."""
    domain = rf.box((0, 0, above), (0.4, 0.2, above + 0.2), cells, cell)
    domain = domain.with_cells("part", lambda x: x[0] <= 0.2 + 1e-9)
    domain = domain.with_cells("all", lambda x: x[0] > -1)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))
    return rf.Scene(domain, material, effects, **how)


# Plane waves --------------------------------------------------------------------------------------


def bar_against_wall(n: int, steps: int) -> dict[str, float]:
    """n cells at v = c/500, so many steps while a wave passes one: force, duration and rebound."""
    L, S, rho, nu, E = 1.0, 0.01**2, 1.0, 0.3, 1.0
    c = float(np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / rho))
    v, dt = c / 500, L / n / c / steps
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
    return {
        "energy_drift": energy_drift(reports),
        "force_error": abs(force[middle].mean() / known - 1),
        "duration_error": abs(duration * c / (2 * L) - 1),
        "rebound_error": abs(rebound / v - 1),
    }


def bars(short: bool) -> dict[str, float]:
    """A bar hits an equal one, and one of the same wave speed and three times the impedance."""
    n, out = 60 if short else 200, dict[str, float]()
    for name, ratio in (("equal", 1.0), ("different", 3.0)):
        found = collided(n, ratio)
        out[f"{name}_speed_error"] = found.pop("speed_error")
        out |= {drift: max(value, out.get(drift, 0.0)) for drift, value in found.items()}
    return out


def collided(n: int, ratio: float) -> dict[str, float]:
    """A bar of n cells hits one of another impedance Z₂.

    Then it has (Z₁ - Z₂)/(Z₁ + Z₂) of its speed, and the other 2 Z₁/(Z₁ + Z₂).
    """
    E, nu = 1.0, 0.3
    c = float(np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))))
    soft, stiff = (rf.StVenantKirchhoff(rho=k, E=k * E, nu=nu) for k in (1.0, ratio))
    scene, balance = two_bars(n, soft, stiff), Balance()
    for last in rf.simulate(scene, 1 / n / c, 2.6 / c):
        balance.follow(last)
    X, m = scene.space.tabulate_dof_coordinates()[:, 0], scene.nodal_mass
    speed = last.state.v.x.array.reshape(-1, 3)[:, 0]
    here = np.arange(X.size) < scene.owned_nodes
    own = [here & (1 + 0.1 * APART > X), here & (1 + 0.1 * APART < X)]
    of = [scene.sum((m * speed)[k].sum()) / scene.sum(m[k].sum()) / SPEED for k in own]
    off = np.subtract(of, [(1 - ratio) / (1 + ratio), 2 / (1 + ratio)])
    drifts = {"energy_drift": balance.energy, "linear_momentum_drift": balance.momenta[0]}
    return {"speed_error": float(np.abs(off).max()), **drifts}


APART, SIDE, SPEED = 2e-4, 0.01, 2e-3  # m, m, m/s; of the bars


def two_bars(n: int, one: rf.Material, other: rf.Material, length: int = 1) -> rf.Scene:
    """Two bars in a row, of n cells a metre: one of a metre, thrown at one of so many metres."""
    middle, spans = 1 + APART / 2, ((0, 1), (1 + APART, 1 + APART + length))
    domain = boxes(*(((a, 0, 0), (b, SIDE, SIDE), (round(b - a) * n, 1, 1)) for a, b in spans))
    domain = domain.with_cells("first", lambda x: x[0] < middle)
    domain = domain.with_cells("second", lambda x: x[0] > middle)
    domain = domain.with_facets("end", lambda x: np.abs(x[0] - 1) < 0.1 * APART)
    domain = domain.with_facets("begin", lambda x: np.abs(x[0] - 1 - APART) < 0.1 * APART)

    def thrown(x: np.ndarray) -> np.ndarray:
        return np.where(x[0] > middle, 0.0, SPEED) * np.array([[1.0], [0.0], [0.0]])

    held = rf.Fixed("first", "yz"), rf.Fixed("second", "yz")
    contact = rf.Contact("end", against="begin", title="blow")
    effects = [contact, *held, rf.InitialVelocity(function=thrown)]
    probes = {"end": (1, SIDE / 2, SIDE / 2), "begin": (1 + APART, SIDE / 2, SIDE / 2)}
    return rf.Scene(domain, {"first": one, "second": other}, effects, probes=probes)


# A block at obstacles, and in a hollow one --------------------------------------------------------

MASSES = "lumped", "consistent"
MIDDLE = 0.2, 0.1, 0.11
OBSTACLES = {
    "plane": FLOOR,
    "sphere": rf.Sphere((0.2, 0.1, -0.5), 0.5),
    "in_a_sphere": rf.Sphere(MIDDLE, 0.29, inside=True),
    "cylinder": rf.Cylinder((0.2, 0.1, -0.5), 0.5, axis=(0, 1, 0)),
    "in_a_cylinder": rf.Cylinder(MIDDLE, 0.26, axis=(0, 1, 0), inside=True),
}
PARTS = {"flexible": [], "rigid": [rf.Rigid()], "mixed": [rf.Rigid("part")]}


def followed(run: Iterator[rf.Report], short: bool) -> Balance:
    """The balance over 1000 steps in contact, or over four times as many steps; short over 60."""
    wanted, balance = 60 if short else 1000, Balance()
    for report in run:
        balance.follow(report)
        if balance.touching >= wanted or balance.steps >= 4 * wanted:
            break
    return balance


def counted(balances: list[Balance]) -> dict[str, float]:
    """Steps of runs, and the fewest in contact."""
    fewest = min(balance.touching for balance in balances)
    return {"fewest_steps_in_contact": fewest, "steps": sum(b.steps for b in balances)}


def energy_in_contact(short: bool) -> dict[str, float]:
    """The worst balance of all divisions and masses per obstacle.

    From a sphere or a cylinder it would fall: a soft spring keeps it there.
    """
    runs = [(n, p, m) for n in OBSTACLES for p in PARTS for m in MASSES][:: 5 if short else 1]
    balances = [followed(_at_obstacle(*run), short) for run in runs]
    out: dict[str, float] = {}
    for (name, *_), balance in zip(runs, balances, strict=True):
        out[name] = max(out.get(name, 0.0), balance.energy)
    return {"energy_drift": max(out.values()), **counted(balances), **out}


def _at_obstacle(name: str, parts: str, mass: str) -> Iterator[rf.Report]:
    thrown = rf.InitialVelocity(linear=(0.3, 0, -0.5), angular=(1, 2, 0.5))
    contact = rf.Contact("skin", against=OBSTACLES[name], stiffness=2e6)
    kept = [rf.Spring("all", 2e3)] if name in ("sphere", "cylinder") else []
    effects = contact, thrown, rf.Gravity((0, 0, -30.0)), *kept, *PARTS[parts]
    return rf.simulate(block(*effects, above=0.01, mass=mass), 1e-3, 1e3, progress=False)


LOW, HIGH = np.array([0.1, 0.1, 0.1]), np.array([0.4, 0.3, 0.3])  # m; of the hollow
PLAY = 0.01  # m; between hollow and block
OF_PAIR = {
    "flexible": (),
    "one_rigid": (rf.Rigid("block"),),
    "both_rigid": (rf.Rigid("block"), rf.Rigid("shell")),
    "mixed": (rf.Rigid("block"), rf.Rigid("half")),
}


def energy_of_pairs(short: bool) -> dict[str, float]:
    """The worst of all divisions and masses, nodes of each surface against facets of the other."""
    runs = [(p, m) for p in OF_PAIR for m in MASSES][:: 3 if short else 1]
    balances = [followed(_in_hollow(*run), short) for run in runs]
    return {
        "energy_drift": max(b.energy for b in balances),
        "linear_momentum_drift": max(b.momenta[0] for b in balances),
        "angular_momentum_drift": max(b.momenta[1] for b in balances),
        **counted(balances),
    }


def _in_hollow(parts: str, mass: str) -> Iterator[rf.Report]:
    def thrown(x: np.ndarray) -> np.ndarray:
        turns = np.array([0.2 - x[2], 0 * x[0], x[0] - 0.25])
        return np.where(_of_block(x), [[0.4], [0.25], [0.3]] + 2 * turns, 0.0)

    both = [rf.Contact("skin", against="wall", stiffness=2e6)]
    both += [rf.Contact("wall", against="skin", stiffness=2e6)]
    effects = [*both, rf.InitialVelocity(function=thrown), *OF_PAIR[parts]]
    return rf.simulate(rf.Scene(_hollow(), SOFT, effects, mass=mass), 1e-3, 1e3, progress=False)


def _of_block(x: np.ndarray) -> np.ndarray:
    """Points that are within the hollow and not at its wall."""
    inside = (x > LOW[:, None] + 0.5 * PLAY) & (x < HIGH[:, None] - 0.5 * PLAY)
    return np.asarray(inside.all(axis=0))


def _at_wall(x: np.ndarray) -> np.ndarray:
    inside = (x > LOW[:, None] - 1e-6) & (x < HIGH[:, None] + 1e-6)
    return inside.all(axis=0) & ~_of_block(x)


def _hollow() -> rf.Domain:
    """Cells of 0.1 m of a box without its middle, and of a smaller box in there."""
    full = (0, 0, 0), (0.5, 0.4, 0.4), (5, 4, 4)
    domain = boxes(full, (LOW + PLAY, HIGH - PLAY, (3, 2, 2)), hollow=(LOW, HIGH))
    domain = domain.with_cells("block", _of_block).with_cells("shell", lambda x: ~_of_block(x))
    domain = domain.with_cells("half", lambda x: ~_of_block(x) & (x[0] <= 0.3 + 1e-9))
    return domain.with_facets("skin", _of_block).with_facets("wall", _at_wall)


# One contact --------------------------------------------------------------------------------------


def bounces(wanted: int, dt: float) -> dict[str, float]:
    """A rigid block falls flat again and again: error of the height it regains, relative."""
    g, height = 10.0, 0.05
    contact = rf.Contact("skin", against=FLOOR)
    # So large an inertia that rounding does not make it rock.
    heavy = rf.Rigid("all", mass=16.0, inertia=1e9 * np.eye(3))
    scene = block(contact, rf.Gravity((0, 0, -g)), heavy, above=height)
    mass, found, worst, rises = 0.4 * 0.2 * 0.2 * 1000.0, 0, 0.0, False
    for r in rf.simulate(scene, dt, 1e3):
        v = r.linear_momentum[2] / mass
        if rises and v <= 0:
            found += 1
            top = r.rigid.r[0, 2] - 0.1 + v * v / (2 * g)  # at the instant between two steps
            worst = max(worst, abs(top / height - 1))
        rises = v > 0
        if found == wanted:
            break
    return {"bounces": found, "height_error": worst}


def friction(short: bool) -> dict[str, float]:
    """Way of a block that slides to rest, and creep of one on a slope."""
    slides, creeps = slid(1e-3), crept()
    return slides | creeps | {"energy_drift": max(f["energy_drift"] for f in (slides, creeps))}


def slid(dt: float) -> dict[str, float]:
    """A block slides to rest, in v²/(2 μ g)."""
    mu, creep, g, v, k = 0.3, 1e-4, 10.0, 0.5, 1e8
    contact = rf.Contact("z0", against=FLOOR, stiffness=k, friction=mu, creep=creep)
    effects = [contact, rf.Rigid(), rf.InitialVelocity(linear=(v, 0, 0)), rf.Gravity((0, 0, -g))]
    slides = list(rf.simulate(block(*effects, above=-200.0 * g / k), dt, 0.3))
    way = slides[-1].rigid.r[0, 0] - 0.2
    gains = [b.energy - a.energy - b.work_of_loads for a, b in pairwise(slides)]
    lost = sum(r.dissipated.get("Contact", 0.0) for r in slides)
    return {
        "way_error": abs(way / (v * v / (2 * mu * g)) - 1),
        "lost_by_kinetic": lost / slides[0].kinetic,
        "largest_gain_of_energy": max(gains) / slides[0].energy,
        "energy_drift": energy_drift(slides),
    }


def crept() -> dict[str, float]:
    """A block on a slope below the angle of friction creeps by ε tan φ/√(μ² - tan² φ)."""
    mu, slope, creep, g, k = 0.5, 0.4, 1e-3, 10.0, 1e8
    down = g * np.array([np.sin(np.arctan(slope)), 0, -np.cos(np.arctan(slope))])
    contact = rf.Contact("z0", against=FLOOR, stiffness=k, friction=mu, creep=creep)
    scene = block(contact, rf.Rigid(), rf.Gravity(tuple(down)), above=200.0 * down[2] / k)
    creeps = list(rf.simulate(scene, 2e-3, 0.1))
    begin, end = creeps[10], creeps[-1]  # velocities at the ends of steps swing about the mean
    speed = (end.rigid.r - begin.rigid.r)[0, 0] / (end.t - begin.t)
    fastest = creep * slope / np.sqrt(mu**2 - slope**2)
    return {"creep_by_theory": speed / fastest, "energy_drift": energy_drift(creeps)}


def hertz(short: bool) -> dict[str, float]:
    """A rigid sphere slowly pressed into a quarter of a block: force and approach."""
    R, nu, E, depth, rho = 1.0, 0.3, 1e6, 4e-4, 1000.0
    a = float(np.sqrt(R * depth))
    n, growth, first = (12, 1.45, a / 4) if short else (16, 1.33, a / 7)
    lines = np.r_[0.0, np.cumsum(first * growth ** np.arange(n))]

    def place(x: np.ndarray) -> np.ndarray:
        """Cells grow away from the origin, below z = 0."""
        grown = np.interp([x[0], x[1], 1 - x[2]], np.linspace(0, 1, n + 1), lines)
        return grown * np.array([[1.0], [1.0], [-1.0]])

    domain = block_of((n, n, n), place)
    fall, calm = 0.2, 0.1  # s, slow against L/c = 0.03 s
    ball = rf.Sphere((0, 0, R), R, path=lambda t: (0, 0, -depth * min(t / fall, 1.0)))
    contact = rf.Contact("z1", against=ball, title="ball")
    held = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("z0")]
    effects = [contact, *held, rf.MassDamping(200.0)]
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=E, nu=nu, rho=rho), effects)
    *_, last = rf.simulate(scene, 0.01, fall + calm)
    known = 4 / 3 * E / (1 - nu**2) * np.sqrt(R) * depth**1.5
    force = -4 * last.touches["ball"].force[2]
    return {"force_error": abs(force / known - 1), "penetration_by_approach":
            last.touches["ball"].penetration / depth}  # fmt: skip


# What the look for facets takes of a step ---------------------------------------------------------


def share_of_search(short: bool) -> dict[str, float]:
    """Part of a flexible step of two surfaces, both ways, and of one skin that may meet itself."""
    both = rf.Contact("lower", against="upper"), rf.Contact("upper", against="lower")
    found = _share(7 if short else 16, *both)
    of_skin = _share(7 if short else 16, rf.Contact("skin", against="skin"))
    return {**found, "search_of_skin_by_step": of_skin["search_by_step"]}


def _share(n: int, *contacts: rf.Contact) -> dict[str, float]:
    domain = boxes(
        ((0, 0, 0), (0.2, 0.2, 0.2), (n, n, n)),
        ((0.003, 0.005, 0.2001), (0.203, 0.205, 0.4001), (n, n, n)),
    )
    domain = domain.with_facets("lower", lambda x: x[2] < 0.20005)
    domain = domain.with_facets("upper", lambda x: x[2] > 0.20005)
    domain = domain.with_facets("skin", lambda x: np.full(x.shape[1], True))

    def thrown(x: np.ndarray) -> np.ndarray:
        return np.where(x[2] > 0.20005, -0.3, 0.3) * np.array([[0.0], [0.0], [1.0]])

    scene = rf.Scene(domain, SOFT, [*contacts, rf.InitialVelocity(function=thrown)])
    PETSc.Log.begin()
    search, wall, begun, steps = PETSc.Log.Event("rigidfxSearch"), 0.0, 0.0, 0
    for r in rf.simulate(scene, 2e-4, 12 * 2e-4, progress=False):
        if r.step == 2:  # buffers and kernels are there
            begun = search.getPerfInfo()["time"]
        elif r.step > 2:
            wall, steps = wall + r.wall, steps + 1
    spent = search.getPerfInfo()["time"] - begun
    return {
        "search_by_step": spent / wall,
        "step_ms": 1e3 * wall / steps,
        "unknowns": r.unknowns,
        "touching": float(sum(touch.nodes for touch in r.touches.values())),
    }


# Cases and bounds --------------------------------------------------------------------------------

CASES: dict[str, Callable[[bool], dict[str, float]]] = {
    "wall": lambda short: bar_against_wall(200, 1 if short else 2),
    "bars": bars,
    "energy": energy_in_contact,
    "pairs": energy_of_pairs,
    "bounces": lambda short: bounces(20 if short else 100, 2e-3),
    "hertz": hertz,
    "friction": friction,
    "search": share_of_search,
}

# The most that each number may be.
BOUNDS = {
    "energy_drift": 1e-11,
    "linear_momentum_drift": 1e-12,
    "angular_momentum_drift": 1e-12,
    "duration_error": 0.02,
    "rebound_error": 0.02,
    "equal_speed_error": 0.02,
    "different_speed_error": 0.03,
    "height_error": 1e-9,
    "way_error": 0.01,
    "creep_by_theory": 1.01,
    "largest_gain_of_energy": 1e-12,
    "force_error": 0.03,
}
# Of 29 478 unknowns.
IN_FULL = {"search_by_step": 0.05, "search_of_skin_by_step": 0.05}
BOUNDS_OF = {"hertz": {"force_error": 0.05}}  # where a case has another


if __name__ == "__main__":
    parser = Parser(__file__, __doc__.splitlines()[0], "fewer cells, steps and bounces")
    parser.add_only("cases")
    options = parser.read()
    cases = {name: CASES[name](options.short) for name in chosen(options, CASES)}
    conclude(options.out, {**cases.get("wall", {}), "cases": cases})
    for name, found in cases.items():
        bounds = BOUNDS if options.short else {**BOUNDS, **IN_FULL}
        for number, most in {**bounds, **BOUNDS_OF.get(name, {})}.items():
            assert found.get(number, 0.0) <= most, (name, number, found[number])
    for name in {"energy", "pairs"} & set(cases):
        assert cases[name]["fewest_steps_in_contact"] >= (60 if options.short else 1000), name

"""Energy and momenta of a block that rattles at obstacles or in a hollow one, whatever is rigid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from common import boxes

import rigidfx as rf

from .blocks import FLOOR, SOFT, Balance, block

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


def followed(run: Iterator[rf.Report], short: bool, free: bool = False) -> Balance:
    """The balance over 1000 steps in contact, or over four times as many steps; short over 60."""
    wanted, balance = 60 if short else 1000, Balance(free)
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
    balances = [followed(_in_hollow(*run), short, free=True) for run in runs]
    return {
        "energy_drift": max(b.energy for b in balances),
        "linear_momentum_drift": max(b.linear for b in balances),
        "angular_momentum_drift": max(b.angular for b in balances),
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

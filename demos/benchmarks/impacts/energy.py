"""Energy of a block that rattles at an obstacle, whatever it is and whatever is rigid."""

from __future__ import annotations

from collections.abc import Iterator

import rigidfx as rf

from .blocks import FLOOR, Balance, block

MIDDLE = 0.2, 0.1, 0.11
OBSTACLES = {
    "plane": FLOOR,
    "sphere": rf.Sphere((0.2, 0.1, -0.5), 0.5),
    "in_a_sphere": rf.Sphere(MIDDLE, 0.29, inside=True),
    "cylinder": rf.Cylinder((0.2, 0.1, -0.5), 0.5, axis=(0, 1, 0)),
    "in_a_cylinder": rf.Cylinder(MIDDLE, 0.26, axis=(0, 1, 0), inside=True),
}
PARTS = {"flexible": [], "rigid": [rf.Rigid()], "mixed": [rf.Rigid("part")]}
MASSES = "lumped", "consistent"


def energy_in_contact(short: bool) -> dict[str, float]:
    """The worst balance of all divisions and masses per obstacle, over so many steps in contact.

    From a sphere or a cylinder it would fall: a soft spring keeps it there.
    """
    wanted = 60 if short else 1000
    runs = [(n, p, m) for n in OBSTACLES for p in PARTS for m in MASSES]
    out: dict[str, float] = {}
    fewest, steps = 10**9, 0
    for name, parts, mass in runs[:: 5 if short else 1]:
        balance = Balance()
        for report in _rattling(name, parts, mass):
            balance.follow(report)
            if balance.touching >= wanted or balance.steps >= 4 * wanted:
                break
        out[name] = max(out.get(name, 0.0), balance.energy)
        fewest, steps = min(fewest, balance.touching), steps + balance.steps
    worst = max(out.values())
    return {"energy_drift": worst, "fewest_steps_in_contact": fewest, "steps": steps, **out}


def _rattling(name: str, parts: str, mass: str) -> Iterator[rf.Report]:
    thrown = rf.InitialVelocity(linear=(0.3, 0, -0.5), angular=(1, 2, 0.5))
    contact = rf.Contact("skin", against=OBSTACLES[name], stiffness=2e6)
    kept = [rf.Spring("all", 2e3)] if name in ("sphere", "cylinder") else []
    effects = contact, thrown, rf.Gravity((0, 0, -30.0)), *kept, *PARTS[parts]
    return rf.simulate(block(*effects, above=0.01, mass=mass), 1e-3, 1e3, progress=False)

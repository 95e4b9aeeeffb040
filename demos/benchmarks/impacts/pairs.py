"""Energy and both momenta of a block that rattles in a hollow one, free in space."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from mpi4py import MPI

import rigidfx as rf

from .blocks import SOFT, Balance

LOW, HIGH = np.array([0.1, 0.1, 0.1]), np.array([0.4, 0.3, 0.3])  # m; of the hollow
PLAY = 0.01  # m; between hollow and block
PARTS = {
    "flexible": (),
    "one_rigid": (rf.Rigid("block"),),
    "both_rigid": (rf.Rigid("block"), rf.Rigid("shell")),
    "mixed": (rf.Rigid("block"), rf.Rigid("half")),
}


def energy_of_pairs(short: bool) -> dict[str, float]:
    """The worst of all divisions and masses, nodes of each surface against facets of the other."""
    wanted = 60 if short else 1000
    out = {"energy_drift": 0.0, "linear_momentum_drift": 0.0, "angular_momentum_drift": 0.0}
    fewest, steps = 10**9, 0
    runs = [(p, m) for p in PARTS for m in ("lumped", "consistent")]
    for parts, mass in runs[:: 3 if short else 1]:
        balance = Balance(free=True)
        for report in _rattling(parts, mass):
            balance.follow(report)
            if balance.touching >= wanted or balance.steps >= 4 * wanted:
                break
        found = balance.energy, balance.linear, balance.angular
        out = {name: max(out[name], value) for name, value in zip(out, found, strict=True)}
        fewest, steps = min(fewest, balance.touching), steps + balance.steps
    return {**out, "fewest_steps_in_contact": fewest, "steps": steps}


def _rattling(parts: str, mass: str) -> Iterator[rf.Report]:
    def thrown(x: np.ndarray) -> np.ndarray:
        turns = np.array([0.2 - x[2], 0 * x[0], x[0] - 0.25])
        return np.where(_of_block(x), [[0.4], [0.25], [0.3]] + 2 * turns, 0.0)

    both = [rf.Contact("skin", against="wall", stiffness=2e6)]
    both += [rf.Contact("wall", against="skin", stiffness=2e6)]
    effects = [*both, rf.InitialVelocity(function=thrown), *PARTS[parts]]
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


def boxes(*ends: Any, hollow: tuple[np.ndarray, np.ndarray] | None = None) -> rf.Domain:
    """Boxes of hexahedra that share no node, each from corner to corner in so many cells.

    The first of them has no cells within `hollow`, if there is one.
    """
    every, first = [], 0
    for k, (low, high, count) in enumerate(ends):
        points, cells = _box(low, high, count)
        if hollow is not None and k == 0:
            middles = points[cells].mean(axis=1)
            cells = cells[~((middles > hollow[0]) & (middles < hollow[1])).all(axis=1)]
        every.append((points, cells + first))
        first += len(points)
    points, cells = (np.concatenate(part) for part in zip(*every, strict=True))
    used, cells = np.unique(cells.reshape(-1), return_inverse=True)
    mine = slice(0 if MPI.COMM_WORLD.rank else None)
    return rf.from_arrays(points[used][mine], cells.reshape(-1, 8)[mine])


def _box(low: Any, high: Any, count: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Points and hexahedra of a box from corner to corner."""
    lines = [np.linspace(*ends) for ends in zip(low, high, np.add(count, 1), strict=True)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(np.add(count, 1))
    nx, ny, nz = count
    corners = [
        number[a : a + nx, b : b + ny, c : c + nz].reshape(-1)
        for c in (0, 1)
        for b in (0, 1)
        for a in (0, 1)
    ]
    return points, np.stack(corners, axis=1)

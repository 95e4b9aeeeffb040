"""A bar that hits a wall."""

from __future__ import annotations

import numpy as np

import rigidfx as rf

from .blocks import drift


def bar_against_wall(short: bool) -> dict[str, float]:
    """200 cells at v = c/500: errors of force, duration and rebound."""
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
    return {
        "energy_drift": drift(reports),
        "force_error": abs(force[middle].mean() / known - 1),
        "duration_error": abs(duration * c / (2 * L) - 1),
        "rebound_error": abs(rebound / v - 1),
    }

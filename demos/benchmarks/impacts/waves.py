"""Plane waves: a bar that hits a wall, and bars that hit others."""

from __future__ import annotations

import numpy as np
from common import boxes

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


def two_bars(n: int, apart: float, second: int = 1) -> rf.Domain:
    """Two bars in a row, of n cells a metre, with a gap [m]: one of a metre, a second one."""
    ends = (0, 1), (1 + apart, 1 + apart + second)
    domain = boxes(*(((a, 0, 0), (b, 0.01, 0.01), (round(b - a) * n, 1, 1)) for a, b in ends))
    middle = 1 + apart / 2
    domain = domain.with_cells("first", lambda x: x[0] < middle)
    domain = domain.with_cells("second", lambda x: x[0] > middle)
    domain = domain.with_facets("end", lambda x: np.abs(x[0] - 1) < 0.1 * apart)
    return domain.with_facets("begin", lambda x: np.abs(x[0] - 1 - apart) < 0.1 * apart)

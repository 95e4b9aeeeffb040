"""A bar that hits a wall, beside Newmark's method with the same penalty."""

from __future__ import annotations

import numpy as np

import rigidfx as rf

from .blocks import drift


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

"""A bar that hits another: equal ones, and ones of different impedances."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import rigidfx as rf

from .blocks import drift


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
    """Two bars in a row, which share no node.

    Args:
        n: Cells of a metre.
        apart: Gap [m].
        second: Length of the second [m]; the first has one metre.
    """
    section = np.array([(y, z) for y in (0, 0.01) for z in (0, 0.01)])
    places = np.linspace(0, 1, n + 1), 1 + apart + np.linspace(0, second, second * n + 1)
    points = [(x, *yz) for x in np.concatenate(places) for yz in section]
    corners = np.array([0, 4, 2, 6, 1, 5, 3, 7])
    firsts = 4 * np.delete(np.arange((1 + second) * n + 1), n)  # no cell bridges the gap
    cells = firsts[:, None] + corners
    mine = slice(0 if MPI.COMM_WORLD.rank else None)
    middle = 1 + apart / 2
    domain = rf.from_arrays(np.array(points)[mine], cells[mine])
    domain = domain.with_cells("first", lambda x: x[0] < middle)
    domain = domain.with_cells("second", lambda x: x[0] > middle)
    domain = domain.with_facets("end", lambda x: np.abs(x[0] - 1) < 0.1 * apart)
    return domain.with_facets("begin", lambda x: np.abs(x[0] - 1 - apart) < 0.1 * apart)

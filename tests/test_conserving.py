"""A step keeps energy and momenta whatever its Δt."""

from __future__ import annotations

import numpy as np
import pytest
from histories import column, drift, show

import rigidfx as rf

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
NEWTON = {"snes_lag_jacobian": 1}


def turning(*effects, velocity=1.0, cells=(8, 2, 2), **options):
    """A bar of steel that turns, and bends to and fro."""
    bar = rf.box((0, 0, 0), (1, 0.2, 0.2), cells)
    bar = bar.with_cells("end", lambda x: x[0] > 0.8)

    def bending(x):
        return velocity * np.outer([0, 0, 1], np.cos(2 * np.pi * x[0]))

    start = rf.InitialVelocity(angular=(1.0, 4.0, 0.5), function=bending)
    return rf.Scene(bar, STEEL, [start, *effects], **options)


def changing(steps, seed=1):
    """A run's Δt, another one in each step, and its end [s]."""
    dts = np.exp(np.random.default_rng(seed).uniform(np.log(1e-5), np.log(1e-2), steps))
    ends = np.cumsum(dts)
    return dict(zip([0.0, *ends], dts, strict=False)), ends[-1]


MOTIONS = {
    "free": lambda: turning(),
    "rigid end": lambda: turning(rf.Rigid("end")),
    "enhanced": lambda: turning(element="enhanced"),
    "second order": lambda: turning(cells=(6, 1, 1), order=2, mass="consistent"),
}


RUNS = [("free", {}, 500), ("free", NEWTON, 150)]
RUNS += [(name, {}, 150) for name in MOTIONS if name != "free"]


@pytest.mark.parametrize(("name", "method", "steps"), RUNS)
def test_energy_and_momenta_stay_through_changes_of_the_time_step(name, method, steps):
    """By up to a thousand times each; it was 1e-10 and more by kept tangents."""
    dt, t_end = changing(steps)
    reports = list(rf.simulate(MOTIONS[name](), dt, t_end, petsc_options=method))
    assert len(reports) == steps + 1
    H, J, L = (column(reports, k) for k in ("energy", "angular_momentum", "linear_momentum"))
    L = np.linalg.norm(L, axis=1).max() / reports[0].momentum_scale
    show(H=drift(H), J=drift(J), L=L, iterations=column(reports, "iterations")[1:].mean())
    assert max(drift(H), drift(J), L) <= 1e-11

"""What rounding does to a body far from where it began: the law that docs/limits.md states."""

import re
from pathlib import Path

import numpy as np
import pytest
from histories import EPS, show

import rigidfx as rf

LIMITS = Path(__file__).resolve().parent.parent / "docs" / "limits.md"
STEPS, H = 50, 0.5


def drifts(cells):
    """Changes of energy and momenta, relative, of a tumbling bar so many cell sizes away."""
    start = rf.InitialVelocity(
        linear=(0.1, 0, 0),
        angular=(0.15, 0.05, 0.5),
        function=lambda X: np.stack([0 * X[0], 0.1 * np.sin(3 * X[0]), 0.1 * X[0] * X[1]]),
    )
    bar = rf.box((0, 0, 0), (2, 1, 1), (4, 2, 2))
    scene = rf.Scene(bar, rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=1000.0), [start])
    away = cells * H * np.array([1.0, 0.7, 0.3])
    energy, linear, angular = [], [], []
    for report in rf.simulate(scene, 0.05, STEPS * 0.05):
        if report.step == 0:  # a shift changes neither forces nor velocities
            report.state.u.x.array.reshape(-1, 3)[:] += away
            continue
        energy.append(report.energy)
        linear.append(report.linear_momentum)
        angular.append(report.angular_momentum - np.cross(away, report.linear_momentum))
    spin = np.linalg.norm(angular[0])
    return (
        np.ptp(energy) / energy[0],
        np.ptp(linear, axis=0).max() / report.momentum_scale,
        np.ptp(angular, axis=0).max() / spin,
    )


@pytest.mark.parametrize("cells", [1e4, 1e6, 1e8])
def test_drift_grows_with_the_distance(cells):
    """Within a factor of five of the law, either way; linear momentum does not notice."""
    energy, linear, angular = drifts(cells)
    law = 0.2 * EPS * cells * np.sqrt(STEPS)
    show(energy=energy / law, linear=linear, angular=angular / law)
    assert law / 5 < energy < 5 * law
    assert law / 5 < angular < 5 * law
    assert linear < 1e-11


def test_near_its_start_a_body_keeps_all_to_rounding():
    assert max(drifts(0.0)) < 1e-13


def test_the_pages_state_the_law():
    """README does not promise more than docs/limits.md can keep."""
    assert "0.2 ε|u|/h √n" in LIMITS.read_text(encoding="utf-8")
    readme = " ".join((LIMITS.parent.parent / "README.md").read_text(encoding="utf-8").split())
    promise = re.search(r"conserved to 1e-14[^.]*\.", readme)
    assert promise is not None
    assert "docs/limits.md#rounding" in readme[promise.start() : promise.end() + 40]

"""A warning of what turns too far in one step, and none of what does not."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

import rigidfx as rf

DT = 0.1


def spinning(omega, *effects, cells=(2, 1, 1)):
    """A free bar that turns about z, its tip watched."""
    domain = rf.box((-1, -0.5, -0.5), (1, 0.5, 0.5), cells).with_cells("all", lambda X: X[0] < 9)
    start = rf.InitialVelocity(linear=(50.0, 0, 0), angular=(0, 0, omega))
    material = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1.0)
    return rf.Scene(domain, material, [start, *effects], probes={"mid": (0, 0, 0), "x": (1, 0, 0)})


def turned(reports):
    """Angle by which the tip has turned in the first step [rad]."""
    first = reports[1].probes
    x = first["x"] - first["mid"] + (1, 0, 0)
    return float(np.arctan2(x[1], x[0]))


@pytest.mark.parametrize("effects", [(), (rf.Rigid("all"),)], ids=["flexible", "rigid"])
@pytest.mark.parametrize("angle", [1.2, 20.0])
def test_a_large_rotation_is_warned_of_once(effects, angle):
    with pytest.warns(rf.RigidfxWarning, match="rad per step") as shown:
        reports = list(rf.simulate(spinning(angle / DT, *effects), DT, 5 * DT))
    mine = [str(w.message) for w in shown if "rad per step" in str(w.message)]
    assert len(mine) == 1
    assert ("body 'all'" in mine[0]) == bool(effects)
    told = re.search(
        r"by ([\d.e+]+) rad per step .*instead, ([\d.]+) rad.* Δt ≤ ([\d.e-]+) s", mine[0]
    )
    assert told is not None
    found, instead, fine = map(float, told.groups())
    assert found == pytest.approx(angle, rel=0.02)
    assert instead == pytest.approx(2 * np.arctan(angle / 2), rel=0.01)
    assert turned(reports) == pytest.approx(instead, rel=0.02)
    # With the Δt that it names the motion is right to 1 %, and nothing is said.
    reports = list(rf.simulate(spinning(angle / DT, *effects), fine, 2 * fine))
    assert turned(reports) == pytest.approx(angle / DT * fine, rel=0.01)


def test_a_body_that_turns_too_far_for_some_steps_is_warned_of():
    """It spins up and down between two looks at flexible cells: bodies are looked at always."""
    torque = rf.Table((0.0, 2 * DT, 4 * DT, 6 * DT), (1.0, 1.0, -1.0, 0.0))
    couple = rf.Resultant("all", torque=(0, 0, 100.0), time=torque)
    with pytest.warns(rf.RigidfxWarning, match="body 'all' turns at .* rad per step"):
        reports = list(rf.simulate(spinning(0.0, rf.Rigid("all"), couple), DT, 7 * DT))
    assert len(reports) == 8


def test_the_angle_is_that_of_the_fastest_part():
    """One of two bars that turn against each other, so that the whole has no angular momentum."""
    domain = rf.box((0, 0, 0), (5, 1, 1), (5, 1, 1))

    def turning(X):
        left = np.where(X[0] < 2.5, 1.0, -1.0)
        y = X - np.stack([np.where(X[0] < 2.5, 1.0, 4.0), 0 * X[0] + 0.5, 0 * X[0] + 0.5])
        return np.cross((0.0, 0.0, 40.0), (left * y).T).T

    soft = rf.StVenantKirchhoff(E=1e2, nu=0.0, rho=1.0)
    scene = rf.Scene(domain, soft, [rf.InitialVelocity(function=turning)])
    with pytest.warns(rf.RigidfxWarning, match="cell . of the mesh around"):
        list(rf.simulate(scene, DT, DT))


@pytest.mark.parametrize("angle", [0.05, 0.9])
def test_moderate_rotations_pass(angle):
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        list(rf.simulate(spinning(angle / DT), DT, 5 * DT))


def test_fast_vibration_is_no_rotation():
    """Steps of a hundred periods: velocities are high, increments small."""
    bend = rf.InitialVelocity(
        function=lambda X: np.stack([0 * X[0], 0 * X[0], 40 * (X[0] + 1) ** 2])
    )
    domain = rf.box((-1, -0.5, -0.5), (1, 0.5, 0.5), (4, 2, 2))
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1.0), [rf.Fixed("x0"), bend])
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        warnings.filterwarnings("ignore", ".*goes back and forth")
        reports = list(rf.simulate(scene, DT, 5 * DT))
    assert reports[-1].kinetic > 0

"""Andrews' squeezing mechanism: seven bodies, ten hinges, a spring between two points, a motor.

E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Section VII.7, with all data.
"""

from __future__ import annotations

import numpy as np
import pytest
from test_contact_pairs import boxes

import rigidfx as rf

A, B, C = np.array([[-0.06934, -0.00227], [-0.03635, 0.03273], [0.014, 0.072]])  # m
BETA, GAMMA, PHI = -0.0617138900142764, 0.455279819163070, 0.222668390165886  # rad, at the start
DELTA, EPSILON = 0.487364979543843, 1.23054744454982
MASSES = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498  # kg
INERTIAS = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5  # kg m²
TORQUE, STIFFNESS, LENGTH = 0.033, 4530.0, 0.07785  # N m, N/m, m
CRANK, T_END = 15.81077, 0.03  # angle of the crank [rad] at the end [s], without turns taken off


def along(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def across(angle):
    return np.array([np.sin(angle), -np.cos(angle)])


def places():
    """The three moving hinges, the end of the spring, and the centres of mass [m]."""
    pin = 7e-3 * along(BETA)
    knee, F, H = pin - 28e-3 * along(BETA), A + 4e-2 * along(DELTA), A + 4e-2 * across(EPSILON)
    assert knee == pytest.approx(B + 35e-3 * across(GAMMA), abs=1e-15)
    assert knee == pytest.approx(F + 2e-2 * across(PHI + DELTA), abs=1e-15)
    assert knee == pytest.approx(H + 2e-2 * along(EPSILON - PHI), abs=1e-15)
    end = B + 18e-3 * across(GAMMA) + 2e-2 * along(GAMMA)
    centres = (
        92e-5 * along(BETA),
        pin - 115e-4 * along(BETA),
        B + 1874e-5 * across(GAMMA) + 1043e-5 * along(GAMMA),
        F + 579e-5 * across(PHI + DELTA),
        A + 2308e-5 * along(DELTA) - 916e-5 * across(DELTA),
        H + 579e-5 * along(EPSILON - PHI),
        A + 1228e-5 * across(EPSILON) + 449e-5 * along(EPSILON),
    )
    return (pin, knee, F, H), end, centres


def angle_of_crank(steps):
    """Of all bodies rigid, of the published masses and inertias; in as many steps."""
    (pin, knee, F, H), end, centres = places()
    levels = 0.01 * np.arange(7)
    domain = boxes(*(((*(c - 4e-3), z), (*(c + 4e-3), z + 5e-3), (1, 1, 1))
                     for c, z in zip(centres, levels, strict=True)))  # fmt: skip
    for k, z in enumerate(levels, start=1):
        domain = domain.with_cells(f"K{k}", lambda x, z=z: np.abs(x[2] - z - 2.5e-3) < 3e-3)
    bodies = [
        rf.Rigid(f"K{k}", m, J * np.eye(3))
        for k, (m, J) in enumerate(zip(MASSES, INERTIAS, strict=True), start=1)
    ]
    hinges = [
        ("ground", "K1", (0, 0)), ("K1", "K2", pin), ("K3", "K2", knee), ("K3", "K4", knee),
        ("K3", "K6", knee), ("K5", "K4", F), ("K7", "K6", H), ("ground", "K5", A),
        ("ground", "K7", A), ("ground", "K3", B),
    ]  # fmt: skip
    joints = [rf.Revolute(a, b, (*at, 0), (0, 0, 1), name=f"{a} {b}") for a, b, at in hinges]
    spring = rf.SpringDamper(
        *("ground", "K3", STIFFNESS), length=LENGTH, at_a=(*C, 0), at_b=(*end, 0)
    )
    motor = rf.Motor("ground K1", torque=TORQUE)
    steel = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7850.0)
    scene = rf.Scene(domain, steel, [*bodies, *joints, spring, motor])
    work, first, worst = 0.0, 0.0, 0.0
    for report in rf.simulate(scene, T_END / steps, T_END, progress=False):
        work += report.work_of_loads
        first = first if report.step else report.energy
        worst = max(worst, abs(report.energy - first - work))
    assert worst <= 1e-12 * report.energy
    return BETA + report.joints["ground K1"].angle


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:9 of the rows of joints follow from others")  # it is plane
def test_the_crank_turns_as_it_is_published():
    """The error falls with Δt², so that two runs tell the limit to the digits published."""
    coarse, fine = angle_of_crank(150), angle_of_crank(300)
    assert fine == pytest.approx(CRANK, rel=1e-3)
    assert (4 * fine - coarse) / 3 == pytest.approx(CRANK, rel=1e-5)

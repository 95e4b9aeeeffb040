"""Andrews' squeezing mechanism: seven bodies, ten hinges, a spring between two points, a motor.

E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Section VII.7, with all data;
the angle of the crank after 0.03 s is 15.81077 rad.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from bench.mechanism_scenes import Link, linked

import rigidfx as rf

__all__ = ["BETA", "CRANK", "T_END", "squeezer"]

Array = npt.NDArray[np.float64]
A, B, C = np.array([[-0.06934, -0.00227], [-0.03635, 0.03273], [0.014, 0.072]])  # m
BETA, GAMMA, PHI = -0.0617138900142764, 0.455279819163070, 0.222668390165886  # rad, at the start
DELTA, EPSILON = 0.487364979543843, 1.23054744454982
MASSES = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498  # kg
INERTIAS = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5  # kg m²
TORQUE, STIFFNESS, LENGTH = 0.033, 4530.0, 0.07785  # N m, N/m, m
CRANK, T_END = 15.81077, 0.03  # angle of the crank [rad] at the end [s], without turns taken off
STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7850.0)
THICK, APART = 5e-3, 0.01  # m, of the cells that stand for a body, and between their levels


def along(angle: float) -> Array:
    """Unit vector at an angle."""
    return np.array([np.cos(angle), np.sin(angle)])


def across(angle: float) -> Array:
    """The same, turned back by a right angle."""
    return np.array([np.sin(angle), -np.cos(angle)])


def places() -> tuple[tuple[Array, ...], Array, tuple[Array, ...]]:
    """The moving hinges, the end of the spring, and the centres of mass [m]."""
    pin = 7e-3 * along(BETA)
    knee, F, H = pin - 28e-3 * along(BETA), A + 4e-2 * along(DELTA), A + 4e-2 * across(EPSILON)
    same = (
        B + 35e-3 * across(GAMMA),
        F + 2e-2 * across(PHI + DELTA),
        H + 2e-2 * along(EPSILON - PHI),
    )
    assert all(np.abs(knee - other).max() < 1e-15 for other in same)
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


def squeezer() -> rf.Scene:
    """All bodies rigid, of the published masses and inertias."""
    (pin, knee, F, H), end, centres = places()
    links = [
        Link(f"K{k}", (*c, APART * k), (*c, APART * k + THICK), wide=4e-3, gap=0.0)
        for k, c in enumerate(centres, start=1)
    ]
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
    return rf.Scene(linked(links), STEEL, [*bodies, *joints, spring, motor])

"""Mechanisms with published motions.

Andrews' squeezing mechanism has seven bodies, ten hinges, a spring between two points and a motor
(E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, Section VII.7, with all data).

The angle of its crank is extrapolated from two Δt, as are the places of the heavy top; the
error falls with Δt². Exudyn is a peer of two four-bar linkages where it is installed, as
`mechanisms.py` says, in the plane by its generalised α.
"""

import warnings
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from bench.followed import Followed
from bench.mechanism_scenes import Link, bricard, four_bars, heavy_top, linked
from codes import exudyn
from common import ROOT, comm
from mechanisms import python_with_exudyn

import rigidfx as rf

from .row import Found, problem

Array = npt.NDArray[np.float64]
# Parts, points of them in their frames at the start [m], and where these end [m].
UP, TOP = ("up 0", np.array([0.0, 0.5, 0.0])), ("top", np.zeros(3))
END_OF_UP, END_OF_TOP = np.array([0.3284574, 0.9445188]), np.array([-0.15042, -0.72417, -0.67302])
# Of Andrews' mechanism.
A, B, C = np.array([[-0.06934, -0.00227], [-0.03635, 0.03273], [0.014, 0.072]])  # m
BETA, GAMMA, PHI = -0.0617138900142764, 0.455279819163070, 0.222668390165886  # rad, at the start
DELTA, EPSILON = 0.487364979543843, 1.23054744454982
MASSES = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498  # kg
INERTIAS = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5  # kg m²
TORQUE, STIFFNESS, LENGTH = 0.033, 4530.0, 0.07785  # N m, N/m, m
CRANK, T_END = 15.81077, 0.03  # angle of the crank [rad] at the end [s], without turns taken off
STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7850.0)
THICK, APART = 5e-3, 0.01  # m, of the cells that stand for a body, and between their levels


def followed(scene: rf.Scene, dt: float, t_end: float) -> tuple[Followed, int]:
    """A run, and how many equations of its joints follow from others, as a warning says."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        run = Followed(scene, dt, t_end)
    implied = [str(w.message) for w in told if "follow from others" in str(w.message)]
    return run, int(implied[0].split()[0]) if implied else 0


def components(
    name: str, exact: Array, ours: Array, allowed: float | None, **how: object
) -> list[Found]:
    """A place, by its components, relative to its distance from the origin."""
    size = float(np.linalg.norm(exact))
    return [
        Found(f"{axis} {name} [m]", float(a), float(b), allowed, size, **how)
        for axis, a, b in zip("xyz"[: exact.size], exact, ours, strict=False)
    ]


@problem("four-bar linkages", "IFToMM's library of multibody benchmarks, A02")
def four(short: bool) -> Iterator[list[Found]]:
    """Two four-bar linkages after 10 s, and the equations of many that others imply."""
    exact, dt = END_OF_UP, 0.025 if short else 0.005
    run, redundant = followed(four_bars(2), dt, 10.0)
    assert run.drift <= 1e-10  # J
    assert run.gap <= 1e-11  # m
    assert redundant == 6
    how = {"kind": "rigid", "unknowns": run.last.unknowns}
    yield components("after 10 s", exact, run.place(*UP), 0.01, **how)
    python = python_with_exudyn(None)
    if python and not short and comm.size == 1:
        given = {"kind": "four-bars", "n": 2, "dt": dt, "steps": round(10 / dt)}
        found = exudyn(python, ROOT / "out" / "exudyn", given)
        yield components("after 10 s", exact, found["end"], None, kind="Exudyn")
    n = 6 if short else 40
    run, redundant = followed(four_bars(n), 0.01, 0.02 if short else 0.2)
    assert run.drift <= 1e-9
    title, how = f"redundant equations of {n} linkages", how | {"unknowns": run.last.unknowns}
    yield [Found(title, 3 * n, redundant, 0.0, **how)]


@problem("Bricard", "IFToMM's library of multibody benchmarks, A04")
def cube(short: bool) -> Iterator[list[Found]]:
    """The redundant equation of Bricard's mechanism."""
    run, redundant = followed(bricard(), 0.01, 0.1 if short else 10.0)
    assert run.drift <= 1e-10
    how = {"kind": "rigid", "unknowns": run.last.unknowns}
    yield [Found("redundant equations", 1, redundant, 0.0, **how)]


@problem("heavy top", "O. Brüls, A. Cardona, M. Arnold, MMT 48 (2012) 121")
def top(short: bool) -> Iterator[list[Found]]:
    """The centre of the heavy top after 2 s."""
    dt = 1 / 160 if short else 0.001  # s
    ends = [Followed(heavy_top(), h, 2.0).place(*TOP) for h in (2 * dt, dt)]
    place = (4 * ends[1] - ends[0]) / 3
    yield components("after 2 s", END_OF_TOP, place, 0.005, kind="rigid")


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


def angle_of_crank(steps: int) -> float:
    """Andrews' crank at the end [rad]; energy is kept to rounding."""
    run = Followed(squeezer(), T_END / steps, T_END)
    assert run.drift <= 1e-12 * run.last.energy
    return BETA + run.last.joints["ground K1"].angle


@problem("Andrews' squeezer", "E. Hairer, G. Wanner, Solving ODEs II, Section VII.7")
def andrews(short: bool) -> Iterator[list[Found]]:
    """The angle of the crank, extrapolated."""
    steps, allowed = ((80, 160), 1e-4) if short else ((300, 600), 1e-5)
    coarse, fine = (angle_of_crank(n) for n in steps)
    title = "angle of the crank, extrapolated [rad]"
    yield [Found(title, CRANK, (4 * fine - coarse) / 3, allowed, kind="rigid")]

"""Mechanisms with published motions.

The angle of Andrews' crank is extrapolated from two Δt, as are the places of the heavy top; the
error falls with Δt². Exudyn is a peer of two four-bar linkages where it is installed, as
`mechanisms.py` says, in the plane by its generalised α.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from bench.mechanism_scenes import bricard, four_bars, heavy_top
from codes import exudyn
from common import ROOT, comm
from mechanisms import Followed, python_with_exudyn

import rigidfx as rf

from .andrews import BETA, CRANK, T_END, squeezer
from .row import Found, Problem

__all__ = ["ANDREWS", "BRICARD", "FOUR_BARS", "HEAVY_TOP"]

Array = npt.NDArray[np.float64]
# Parts, points of them in their frames at the start [m], and where these end [m].
UP, BAR = ("up 0", np.array([0.0, 0.5, 0.0])), ("bar 2", np.array([0.0, 0.0, 0.5]))
TOP = "top", np.zeros(3)
END_OF_UP, END_OF_TOP = np.array([0.3284574, 0.9445188]), np.array([-0.15042, -0.72417, -0.67302])


def components(
    name: str, exact: Array, ours: Array, allowed: float | None, **how: object
) -> list[Found]:
    """A place, by its components, relative to its distance from the origin."""
    size = float(np.linalg.norm(exact))
    return [
        Found(f"{axis} {name} [m]", float(a), float(b), allowed, size, **how)
        for axis, a, b in zip("xyz"[: exact.size], exact, ours, strict=False)
    ]


def four(short: bool) -> Iterator[list[Found]]:
    """Two four-bar linkages after 10 s, and the equations of many that others imply."""
    exact, dt = END_OF_UP, 0.025 if short else 0.005
    run = Followed(four_bars(2), dt, 10.0, UP)
    assert run.drift <= 1e-10  # J
    assert run.gap <= 1e-11  # m
    assert run.redundant == 6
    yield components("after 10 s", exact, run.end, 0.01, kind="rigid", unknowns=run.unknowns)
    python = python_with_exudyn(None)
    if python and not short and comm.size == 1:
        given = {"kind": "four-bars", "n": 2, "dt": dt, "steps": round(10 / dt)}
        found = exudyn(python, ROOT / "out" / "exudyn", given)
        yield components("after 10 s", exact, found["end"], None, kind="Exudyn")
    n = 6 if short else 40
    run = Followed(four_bars(n), 0.01, 0.02 if short else 0.2, UP)
    assert run.drift <= 1e-9
    title = f"redundant equations of {n} linkages"
    yield [Found(title, 3 * n, run.redundant, 0.0, kind="rigid", unknowns=run.unknowns)]


def cube(short: bool) -> Iterator[list[Found]]:
    """The redundant equation of Bricard's mechanism."""
    run = Followed(bricard(), 0.01, 0.1 if short else 10.0, BAR)
    assert run.drift <= 1e-10
    yield [Found("redundant equations", 1, run.redundant, 0.0, kind="rigid", unknowns=run.unknowns)]


def top(short: bool) -> Iterator[list[Found]]:
    """The centre of the heavy top after 2 s."""
    dt = 1 / 160 if short else 0.001  # s
    ends = [Followed(heavy_top(), h, 2.0, TOP).end for h in (2 * dt, dt)]
    place = (4 * ends[1] - ends[0]) / 3
    yield components("after 2 s", END_OF_TOP, place, 0.005, kind="rigid")


def angle_of_crank(steps: int) -> float:
    """Andrews' crank at the end [rad]; energy is kept to rounding."""
    work, first, worst = 0.0, 0.0, 0.0
    for report in rf.simulate(squeezer(), T_END / steps, T_END, progress=False):
        work += report.work_of_loads
        first = first if report.step else report.energy
        worst = max(worst, abs(report.energy - first - work))
    assert worst <= 1e-12 * report.energy
    return BETA + report.joints["ground K1"].angle


def andrews(short: bool) -> Iterator[list[Found]]:
    """The angle of the crank, extrapolated."""
    steps, allowed = ((80, 160), 1e-4) if short else ((300, 600), 1e-5)
    coarse, fine = (angle_of_crank(n) for n in steps)
    title = "angle of the crank, extrapolated [rad]"
    yield [Found(title, CRANK, (4 * fine - coarse) / 3, allowed, kind="rigid")]


IFTOMM = "IFToMM's library of multibody benchmarks, "
FOUR_BARS = Problem(IFTOMM + "A02", four)
BRICARD = Problem(IFTOMM + "A04", cube)
HEAVY_TOP = Problem("O. Brüls, A. Cardona, M. Arnold, MMT 48 (2012) 121", top)
ANDREWS = Problem("E. Hairer, G. Wanner, Solving ODEs II, Section VII.7", andrews)

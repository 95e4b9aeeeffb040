"""Mechanisms with published motions: those of `mechanisms.py`, and Andrews' squeezer.

The angle of Andrews' crank is extrapolated from two Δt, as are the places of the heavy top; the
error falls with Δt². Exudyn is a peer where it is installed, as `mechanisms.py` says.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import mechanisms as own
import numpy as np
import numpy.typing as npt
from bench.flexible_crank import crank_motion, flexible_crank, for_exudyn, motion
from bench.mechanism_scenes import bricard, four_bars, heavy_top
from codes import exudyn
from common import ROOT, comm, say
from mpi4py import MPI

import rigidfx as rf

from .andrews import BETA, CRANK, T_END, squeezer
from .row import Found, Problem

__all__ = ["ANDREWS", "BRICARD", "FOUR_BARS", "HEAVY_TOP", "SLIDER_CRANK"]

Array = npt.NDArray[np.float64]


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
    exact, dt = own.END_OF_UP, 0.025 if short else 0.005
    run = own.Followed(four_bars(2), dt, 10.0, own.UP)
    yield components("after 10 s", exact, run.end, 0.01, kind="rigid", unknowns=run.unknowns)
    python = own.python_with_exudyn(None)
    if python and not short and comm.size == 1:
        given = {"kind": "four-bars", "n": 2, "dt": dt, "steps": round(10 / dt)}
        found = exudyn(python, ROOT / "out" / "exudyn", given)
        yield components("after 10 s", exact, found["end"], None, kind="Exudyn")
    n = 6 if short else 40
    run = own.Followed(four_bars(n), 0.01, 0.02 if short else 0.2, own.UP)
    title = f"redundant equations of {n} linkages"
    yield [Found(title, 3 * n, run.redundant, 0.0, kind="rigid", unknowns=run.unknowns)]


def cube(short: bool) -> Iterator[list[Found]]:
    """The redundant equation of Bricard's mechanism."""
    run = own.Followed(bricard(), 0.01, 0.1 if short else 10.0, own.BAR)
    yield [Found("redundant equations", 1, run.redundant, 0.0, kind="rigid", unknowns=run.unknowns)]


def top(short: bool) -> Iterator[list[Found]]:
    """The centre of the heavy top after 2 s."""
    dt = 1 / 160 if short else 0.001  # s
    ends = [own.Followed(heavy_top(), h, 2.0, own.TOP).end for h in (2 * dt, dt)]
    place = (4 * ends[1] - ends[0]) / 3
    yield components("after 2 s", own.END_OF_TOP, place, 0.005, kind="rigid")


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
    steps, allowed = ((100, 200), 1e-4) if short else ((300, 600), 1e-5)
    coarse, fine = (angle_of_crank(n) for n in steps)
    title = "angle of the crank, extrapolated [rad]"
    yield [Found(title, CRANK, (4 * fine - coarse) / 3, allowed, kind="rigid")]


def crank(short: bool) -> Iterator[list[Found]]:
    """A flexible slider-crank beside Exudyn's floating frames with 64 modes a body."""
    if short:  # a case of mechanisms.py
        return
    python = own.python_with_exudyn(None)
    if python is None:
        say("slider-crank: left out, Exudyn is missing; see mechanisms.py")
        return
    dt, steps, theirs = 2e-4, 200, None
    ours = crank_motion(flexible_crank(0.03), dt, steps)
    if comm.rank == 0:
        began = perf_counter()
        given = for_exudyn(flexible_crank(0.03, comm=MPI.COMM_SELF), dt, steps) | {
            "modes": own.MODES
        }
        found = exudyn(python, ROOT / "out" / "exudyn", given)
        say(f"Exudyn: {perf_counter() - began:.1f} s")
        theirs = motion(found["crank"], found["rod"], dt)
    theirs = comm.bcast(theirs)
    titles = (
        ("largest speed of the crank [rad/s]", own.SPEED),
        ("largest bend of the rod [m]", own.DEFLECTION),
    )
    yield [
        Found(title, float(np.abs(b).max()), float(np.abs(a).max()), most, unknowns=ours.unknowns)
        for (title, most), a, b in zip(titles, ours.motion, theirs, strict=True)
    ]


IFTOMM = "IFToMM's library of multibody benchmarks, "
FOUR_BARS = Problem(IFTOMM + "A02", four)
BRICARD = Problem(IFTOMM + "A04", cube)
HEAVY_TOP = Problem("O. Brüls, A. Cardona, M. Arnold, MMT 48 (2012) 121", top)
ANDREWS = Problem("E. Hairer, G. Wanner, Solving ODEs II, Section VII.7", andrews)
SLIDER_CRANK = Problem("Exudyn, floating frames with 64 modes", crank)

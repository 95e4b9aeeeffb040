"""The error motion fails, broken here on purpose: the run warns, releases its bodies and goes on.

What fails at the end of a window is in test_cad_parts.py.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import parallel
import pytest
from error_on_ranks import DT, scene
from mpi4py import MPI

import rigidfx as rf
from rigidfx.decide.policy import CHECKED, FAILED
from rigidfx.error import equations
from rigidfx.error.ending import Ending
from rigidfx.error.impulse import Impulse
from rigidfx.error.linear_motion import LinearMotion
from rigidfx.error.response import AllUnknowns
from rigidfx.flexible.cell_strains import CellStrains
from rigidfx.withheld.body_forces import Withheld


def error(function, *given):
    raise np.linalg.LinAlgError("numbers are not finite")


def no_number(function, *given):
    return np.nan * function(*given)


def no_numbers(function, *given):
    change, span = function(*given)
    return np.nan * change, span


CASES = {  # where it fails, in which call, and how
    "its force": (Withheld, "force", 3, error),
    "its matrices": (equations, "about", 1, error),
    "its step": (LinearMotion, "increment", 3, error),
    "a step without numbers": (LinearMotion, "increment", 3, no_number),
    "strains of cells": (CellStrains, "of", 3, error),
    "strains without numbers": (AllUnknowns, "change", 3, no_numbers),
    "its size": (Ending, "part", 3, error),
    "what bodies withhold": (Impulse, "withheld", 3, error),
    "its motion in bodies": (Impulse, "in_space", 1, error),
}


@pytest.mark.parametrize("case", CASES)
def test_where_it_fails_bodies_are_released_and_the_run_goes_on(case, monkeypatch):
    """Parts freeze again as they qualify, with an e that begins anew."""
    owner, name, when, how = CASES[case]
    function, calls = getattr(owner, name), []

    def broken(*given):
        calls.append(given)
        return how(function, *given) if len(calls) == when else function(*given)

    monkeypatch.setattr(owner, name, broken)
    end = 1.0 if name != "in_space" else 1.7  # a step or more after the second freeze
    with pytest.warns(rf.RigidfxWarning, match="the error motion failed .numbers are not finite"):
        reports = list(rf.simulate(scene, DT, end, rigidify=rf.StrainRate(2e-3, 20 * DT)))
    switches = [(r, e.kind, e.reason) for r in reports for e in r.events]
    assert [kind for _, kind, _ in switches] == ["freeze", "release", "freeze"]
    released, _, reason = switches[1]
    assert reason == (FAILED if name != "in_space" else CHECKED)
    assert not released.bodies
    assert reports[-1].t == pytest.approx(end)
    e = np.array([(r.t, *r.error_motion["tip"]) for r in reports])
    between = (e[:, 0] >= released.t) & (e[:, 0] < switches[2][0].t)
    assert np.isfinite(e).all()
    assert not e[between, 1:].any()
    assert e[e[:, 0] > switches[2][0].t, 1:].any()


@pytest.mark.parallel
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")
def test_a_failure_of_one_rank_is_one_of_all():
    script = Path(__file__).parent / "failing_on_ranks.py"
    one, two = (parallel.run(script, n, 300)["switches"] for n in (1, 2))
    assert one == two
    assert [reason for _, _, reason in one].count(FAILED) == 1

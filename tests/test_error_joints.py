"""The twin's joints hold u + e: a closed chain through half a turn, rigid all through."""

from __future__ import annotations

import warnings
from functools import partial

import numpy as np
from four_bars import MOTOR, four_bars

import rigidfx as rf

DT = 4e-3  # s
SPRUNG = partial(four_bars, MOTOR, rf.JointSpring("D", stiffness=30.0, damping=0.2))


def tips(scene, t_end, rule):
    """Tip in u + e and e of each report, and unknowns in the last."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = [
            (report.probes["tip"], report.error_motion["tip"], report.unknowns)
            for report in rf.simulate(scene, DT, t_end, rigidify=rule, progress=False)
        ]
    return np.array([of[:2] for of in found]), found[-1][2]


def test_what_joints_hold_is_corrected():
    """Bars that are rigid bend in e, and move each other by that; three rows follow from others."""
    twin, _ = tips(SPRUNG(), 0.44, rf.StrainRate(0.0, 1e9, wake="none"))
    run, unknowns = tips(SPRUNG(), 0.44, rf.StrainRate(1e9, 0.06))
    assert unknowns == 18
    off, left = (
        np.linalg.norm(twin[:, 0] - shown, axis=1).max()
        for shown in (run[:, 0] - run[:, 1], run[:, 0])
    )
    assert off > 1e-4
    assert left <= 0.02 * off


def test_what_joints_leave_free_is_not_shown():
    """The phase of a chain that swings by itself would be lost."""
    run, unknowns = tips(four_bars(rf.Gravity((0, -9.81, 0))), 0.2, rf.StrainRate(1e9, 0.06))
    assert unknowns < 156
    np.testing.assert_array_equal(run[:, 1], 0.0)

"""Factors that soft parts keep: the same motions as by Newton's method, and momenta as well."""

from __future__ import annotations

import numpy as np
import pytest
from histories import column, drift, show
from test_kept_tangent import NEWTON, STEPS, follow
from tumbling_l import tumbling_l

import rigidfx as rf
from rigidfx.step.newton import chord

RUBBER = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
KEPT = "kept fgmres+ilu"


@pytest.fixture
def _soft(monkeypatch):
    """Have all systems count as large and soft."""
    monkeypatch.setattr(chord, "DEAR", 0.0)
    monkeypatch.setattr(chord, "FULL_UP_TO", 0)
    monkeypatch.setattr(chord, "STIFF_FROM", 1e9)


@pytest.fixture
def _many_entries(monkeypatch):
    """Have all full factors count as large."""
    monkeypatch.setattr(chord, "FEW", 0.0)


@pytest.mark.usefixtures("_soft", "_many_entries")
@pytest.mark.parametrize("name", ["turning", "held in part", "springs", "rigid middle"])
@pytest.mark.filterwarnings("ignore:Spring on:rigidfx.RigidfxWarning")
def test_the_motion_is_that_of_newtons_method(name):
    mine, newton = follow(name, {}), follow(name, NEWTON)
    assert all(r.solver == KEPT for r in mine[1:])
    tips = [np.array([r.probes["tip"] for r in run]) for run in (mine, newton)]
    apart = np.abs(tips[0] - tips[1]).max() / np.abs(tips[1]).max()
    show(apart=apart, tangents=sum(r.tangents for r in mine))
    assert apart <= 1e-11
    assert sum(r.tangents for r in mine) <= STEPS / 2
    for key in ("energy", "angular_momentum"):
        own, other = (column(run, key)[12:] for run in (mine, newton))
        assert drift(own) <= 2 * drift(other) + 2e-14


def _tumbling():
    """The L at widely varying strains, free after half a second."""
    t = np.array([256.0, 512.0, 768.0]) / 8
    effects = [rf.Traction(n, tuple(f), until=0.5) for n, f in (("top", t), ("side", -t))]
    return rf.Scene(tumbling_l(1), RUBBER, effects)


@pytest.mark.parametrize("solver", [KEPT, "kept preonly"])
def test_soft_parts_keep_factors_and_no_momentum_is_lost(solver, request):
    """672 unknowns: incomplete factors, and full ones by the rules as they are."""
    if solver == KEPT:
        request.getfixturevalue("_many_entries")
    reports = [r for r in rf.simulate(_tumbling(), 0.05, 8.0) if r.t > 0.5]
    kept = [r for r in reports if r.solver.startswith(solver)]
    H, J = (column(reports, key) for key in ("energy", "angular_momentum"))
    show(H=drift(H), J=drift(J), kept=len(kept), of=len(reports))
    assert len(kept) >= 0.9 * len(reports)
    assert sum(r.tangents for r in kept) <= 0.7 * len(kept)
    assert max(drift(H), drift(J)) <= 1e-13

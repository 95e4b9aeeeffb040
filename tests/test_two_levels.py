"""Incomplete factors and a coarse grid in place of factors: the same motions, however it moves."""

from __future__ import annotations

import numpy as np
import pytest
from histories import column, drift, show
from petsc4py import PETSc
from test_kept_tangent import STEEL, STEPS, by_two_levels, follow, keep

import rigidfx as rf
from rigidfx.step.newton import chord

TWO_LEVELS = "kept fgmres+ilu+coarse"


@pytest.fixture
def _two_levels(monkeypatch):
    by_two_levels(monkeypatch)


@pytest.mark.usefixtures("_two_levels")
@pytest.mark.parametrize("name", ["clamped", "turning", "held in part", "rigid middle"])
def test_the_motion_is_that_by_factors(name, monkeypatch):
    mine = follow(name, {})
    monkeypatch.setattr(chord, "FACTORS_UP_TO", 10**6)
    factors = follow(name, {})
    assert all(r.solver == TWO_LEVELS for r in mine[1:])
    assert all(r.solver == "kept preonly+lu" for r in factors[1:])
    tips = [np.array([r.probes["tip"] for r in run]) for run in (mine, factors)]
    apart = np.abs(tips[0] - tips[1]).max() / np.abs(tips[1]).max()
    H, J = (
        [column(run, key)[8:] for run in (mine, factors)] for key in ("energy", "angular_momentum")
    )
    per_iteration = sum(r.linear_iterations for r in mine) / sum(r.iterations for r in mine)
    show(apart=apart, H=drift(H[0]), J=drift(J[0]), per_iteration=per_iteration)
    assert apart <= 1e-11
    assert sum(r.tangents for r in mine) <= STEPS / 2
    assert per_iteration <= 10
    for own, other in (H, J):
        assert drift(own) <= 2 * drift(other) + 2e-14


@pytest.mark.usefixtures("_two_levels")
@pytest.mark.parametrize(
    ("name", "value", "solver"),
    [("ksp_type", "gcr", "kept gcr+ilu+coarse"), ("pc_type", "sor", "kept fgmres+sor+coarse")],
)
def test_its_options_are_obeyed(name, value, solver):
    options = PETSc.Options("rigidfx_incomplete_")
    options[name] = value
    try:
        assert follow("clamped", {})[-1].solver == solver
    finally:
        options.delValue(name)


@pytest.mark.parametrize(("thick", "solver"), [(1, "kept preonly+lu"), (8, TWO_LEVELS)])
def test_what_is_thin_keeps_full_factors(thick, solver, monkeypatch):
    keep(monkeypatch)
    monkeypatch.setattr(chord, "FACTORS_UP_TO", 0)
    monkeypatch.setattr(chord, "SLENDER", 4.0)
    block = rf.box((0, 0, 0), (1, 1, thick / 8), (8, 8, thick))
    scene = rf.Scene(block, STEEL, [rf.Fixed("x0"), rf.Traction("z1", (0.0, 0.0, 1e6))])
    *_, last = rf.simulate(scene, 5e-4, 1e-3)
    assert last.solver == solver

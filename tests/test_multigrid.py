"""Multigrid in place of factors: the same motions, whatever is held, rigid or turning."""

from __future__ import annotations

import numpy as np
import pytest
from histories import column, drift, show
from petsc4py import PETSc
from test_kept_tangent import STEEL, STEPS, by_multigrid, follow

import rigidfx as rf
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.newton import chord
from rigidfx.step.newton.motions import rigid_motions


@pytest.fixture
def _multigrid(monkeypatch):
    by_multigrid(monkeypatch)


@pytest.mark.usefixtures("_multigrid")
@pytest.mark.parametrize("name", ["clamped", "turning", "held in part", "rigid middle"])
def test_the_motion_is_that_by_factors(name, monkeypatch):
    mine = follow(name, {})
    monkeypatch.setattr(chord, "FACTORS_UP_TO", 10**6)
    factors = follow(name, {})
    assert all(r.solver == "kept gmres+gamg" for r in mine[1:])
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


@pytest.mark.usefixtures("_multigrid")
def test_its_options_are_obeyed():
    options = PETSc.Options("rigidfx_multigrid_")
    options["ksp_type"] = "fgmres"
    try:
        assert follow("clamped", {})[-1].solver == "kept fgmres+gamg"
    finally:
        options.delValue("ksp_type")


def _prolongation(held=()):
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), STEEL)
    mask = np.zeros(3 * scene.owned_nodes, dtype=bool)
    mask[list(held)] = True
    owned = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    layout = dof_layout(scene, {0: owned}, Bodies.of_each([]).of, mask)
    return layout, Prolongation(layout, scene.comm)


def test_rigid_motions_are_orthonormal_and_span_what_strains_nothing():
    layout, prolongation = _prolongation()
    X = layout.rows.X
    found = rigid_motions(prolongation, X)
    assert found.T @ found == pytest.approx(np.eye(6), abs=1e-14)
    turning = np.cross([0.3, -0.2, 0.5], X).reshape(-1)
    assert found @ (found.T @ turning) == pytest.approx(turning, abs=1e-14)


def test_motions_that_supports_leave_none_of_are_left_out():
    layout, prolongation = _prolongation(held=[*range(0, 36, 3), *range(1, 36, 3)])
    found = rigid_motions(prolongation, layout.rows.X)
    # Of motions along z are left: the displacement, and rotations about x and y.
    assert found.shape == (12, 3)
    assert found.T @ found == pytest.approx(np.eye(3), abs=1e-14)

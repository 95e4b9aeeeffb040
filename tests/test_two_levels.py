"""Incomplete factors and a coarse grid in place of factors: the same motions, however it moves."""

from __future__ import annotations

import numpy as np
import pytest
from histories import column, drift, show
from petsc4py import PETSc
from test_kept_tangent import STEEL, STEPS, by_two_levels, follow, keep

import rigidfx as rf
from rigidfx.coupling.dof_layout import dof_layout
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.mechanics.bodies import Bodies
from rigidfx.step.newton import chord, two_levels
from rigidfx.step.newton.two_levels import CoarseGrid

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


@pytest.mark.usefixtures("_two_levels")
def test_how_far_it_solves_may_be_told():
    def linear(tolerance):
        options = PETSc.Options("rigidfx_incomplete_")
        options["ksp_rtol"] = tolerance
        try:
            return sum(r.linear_iterations for r in follow("clamped", {}))
        finally:
            options.delValue("ksp_rtol")

    assert linear("1e-6") > 1.2 * linear("1e-2")


def _prolongation(held=()):
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), STEEL)
    mask = np.zeros(3 * scene.owned_nodes, dtype=bool)
    mask[list(held)] = True
    owned = np.arange(scene.mesh.topology.index_map(3).size_local, dtype=np.int32)
    layout = dof_layout(scene, {0: owned}, Bodies.of_each([]).of, mask)
    return layout, Prolongation(layout, scene.comm)


@pytest.mark.parametrize("held", [(), range(1, 36, 3), [*range(0, 12), 17]])
def test_aggregates_have_the_rigid_motions_that_supports_leave(held, monkeypatch):
    monkeypatch.setattr(two_levels, "NODES", 5)
    layout, prolongation = _prolongation(held)
    X = layout.rows.X
    P = two_levels.Aggregates(prolongation).motions(X)
    found = P.getDenseArray() if P.getType().endswith("dense") else P[:, :]
    P.destroy()
    assert found.shape[1] <= found.shape[0]
    assert found.T @ found == pytest.approx(np.eye(found.shape[1]), abs=1e-14)
    moved = np.array([1.0, 2.0, 3.0])
    turning = (np.cross([0.3, -0.2, 0.5], X) + moved).reshape(-1)[prolongation.free]
    assert found @ (found.T @ turning) == pytest.approx(turning, abs=1e-13)


@pytest.mark.usefixtures("_two_levels")
def test_the_coarse_grid_solves_for_its_own_motions(monkeypatch):
    """For A P c the answer is P c, whatever incomplete factors would make of it."""
    off = []
    set_up = CoarseGrid.setUp

    def seen(self, pc):
        set_up(self, pc)
        moved, force = self._equilibrium.tangent_matrix.createVecs()
        found = moved.duplicate()
        self._motion.setRandom()
        self._P.mult(self._motion, moved)
        self._equilibrium.tangent_matrix.mult(moved, force)
        self.apply(pc, force, found)
        found.axpy(-1.0, moved)
        off.append(found.norm() / moved.norm())

    monkeypatch.setattr(CoarseGrid, "setUp", seen)
    follow("rigid middle", {})
    assert max(off) <= 1e-9


@pytest.mark.parametrize(("thick", "solver"), [(1, "kept preonly+lu"), (8, TWO_LEVELS)])
def test_what_is_thin_keeps_full_factors(thick, solver, monkeypatch):
    keep(monkeypatch)
    monkeypatch.setattr(chord, "FACTORS_UP_TO", 0)
    monkeypatch.setattr(chord, "SLENDER", 4.0)
    block = rf.box((0, 0, 0), (1, 1, thick / 8), (8, 8, thick))
    scene = rf.Scene(block, STEEL, [rf.Fixed("x0"), rf.Traction("z1", (0.0, 0.0, 1e6))])
    *_, last = rf.simulate(scene, 5e-4, 1e-3)
    assert last.solver == solver

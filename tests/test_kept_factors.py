"""Ways to keep a tangent: Cholesky's factors, low rank, incomplete factors, a coarse grid."""

import numpy as np
import pytest
from histories import column, drift, show
from petsc4py import PETSc
from test_kept_tangent import DT, NEWTON, SPIN, STEEL, STEPS, by_two_levels, follow, keep
from tumbling_l import tumbling_l

import rigidfx as rf
from rigidfx.linear.linear_solver import FORMER, OF_DEFINITE, has_cholmod, solver_of
from rigidfx.step.newton import chord
from rigidfx.step.newton.kept_tangent import LowRank


@pytest.mark.skipif(not has_cholmod(), reason="PETSc has no CHOLMOD")
def test_what_swings_has_cholesky_factors_and_what_turns_lu(monkeypatch):
    keep(monkeypatch)
    bar = rf.box((0, 0, 0), (1, 0.2, 0.2), (8, 2, 2))
    push = rf.Traction("x1", (0.0, 0.0, 1e6))  # Pa
    long = 10 * DT  # not well-conditioned: else PETSc's own LU would do
    for effect, kind in ((rf.Fixed("x0"), "cholesky"), (SPIN, "lu")):
        reports = rf.simulate(rf.Scene(bar, STEEL, [effect, push]), long, 10 * long)
        kept = [report.solver for report in reports if report.solver.startswith("kept")]
        assert kept[-1] == f"kept preonly+{kind}"


@pytest.mark.parametrize("prefix", [OF_DEFINITE, FORMER])
def test_options_of_definite_systems_count_under_the_former_prefix(prefix):
    ones = np.arange(10, dtype=PETSc.IntType), np.arange(9, dtype=PETSc.IntType), np.ones(9)
    PETSc.Options(prefix)["ksp_type"] = "cg"
    try:
        ksp = solver_of(PETSc.Mat().createAIJ((9, 9), csr=ones, comm=PETSc.COMM_SELF))
    finally:
        PETSc.Options(prefix).delValue("ksp_type")
    assert ksp.getType() == "cg"
    assert not PETSc.Options(OF_DEFINITE).getAll()
    ksp.destroy()


def test_a_corner_that_comes_and_goes_takes_few_tangents(monkeypatch):
    """Two thirds of those without the correction, or less, and the same motion."""

    def struck():
        plastic = rf.StVenantKirchhoff(E=2.4e9, nu=0.35, rho=1200.0)
        bar = rf.box((0, 0, 1e-4), (0.2, 0.1, 0.1001), (8, 4, 4))
        scene = rf.Scene(
            bar.with_facets("skin", lambda x: np.isclose(x[2], 1e-4)),
            plastic,
            [
                rf.Contact("skin", against=rf.Sphere((0.05, 0.05, -0.3), 0.3)),
                rf.InitialVelocity(linear=(0.5, 0, -2.0), angular=(3.0, 20.0, 5.0)),
            ],
        )
        *_, last = reports = list(rf.simulate(scene, 4e-5, 1.6e-3, progress=False))
        return sum(r.tangents for r in reports if r.step), last.angular_momentum

    tangents, momentum = struck()
    monkeypatch.setattr(LowRank, "follow", lambda *given: False)
    without, same = struck()
    assert 3 * tangents <= 2 * without
    assert np.allclose(momentum, same, rtol=1e-9)


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

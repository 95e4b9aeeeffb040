"""A tangent that is kept and turned along: the same motions as by Newton's method.

Run as a script under mpirun, this file reports histories of motions with tangents that are kept.
And when Newton stops: a rule from norms to reasons, and runs whose residuals end in rounding.
"""

import numpy as np
import parallel
import pytest
from histories import EPS, column, drift, imbalance, show

import rigidfx as rf
from rigidfx.step.newton import chord, two_levels
from rigidfx.step.newton.kept_tangent import KeptTangent
from rigidfx.step.newton.stopping_test import ROUNDING, StoppingTest


@pytest.mark.parametrize(
    ("norms", "ends"),
    [
        ([1e-9], False),  # a first guess, unless it is exact
        ([0.0], True),
        ([1e2, 1e-3, 1e-7], True),  # quadratic: what the next iterate would leave is nothing
        ([1e2, 1e-1, 1e-7], False),
        ([1e-3, 1e-1, 5e-6, 4e-6], True),  # a stall; the level is an estimate,
        ([1e-3, 1e-1, 5e-4, 4e-4], False),  # but no worse than this
        ([1e-3, 1e-1, 3e-7, 9e-7], True),  # growth is a stall below the level only
        ([1e-3, 1e-1, 3e-6, 9e-6], False),
        ([1.0, 1e-3, np.nan], True),
        ([1.0, 1e12], True),  # beyond the forces that it is the difference of
    ],
)
def test_an_iteration_ends_at_the_rounding_of_its_forces(norms, ends):
    """Residuals below 1 µN are rounding here."""
    stop = StoppingTest()
    stop.expect_rounding(1e-6 / (ROUNDING * EPS))
    stop.restart()
    reasons = [stop(k, norm) for k, norm in enumerate(norms)]
    assert not any(reasons[:-1])
    assert bool(reasons[-1]) == ends


@pytest.mark.filterwarnings("ignore:In the step from:rigidfx.RigidfxWarning")
def test_no_step_ends_in_a_grown_residual():
    """Halves of 1e10 : 1 in stiffness: all that Newton leaves is rounding."""
    ends = {"stiff": lambda x: x[0] <= 2 + 1e-9, "soft": lambda x: x[0] >= 2 - 1e-9}
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    for name, where in ends.items():
        domain = domain.with_cells(name, where)
    materials = {
        name: rf.StVenantKirchhoff(E=E, nu=0.3, rho=10.0)
        for name, E in (("stiff", 1e14), ("soft", 1e4))
    }
    spin = rf.InitialVelocity(angular=(2.0, 0.3, 0.1))
    scene = rf.Scene(domain, materials, [spin], order=2, mass="consistent")
    reports = list(rf.simulate(scene, 0.05, 3.0))
    H = drift(column(reports, "energy"))
    show(H=H, most=max(r.iterations for r in reports))
    assert sum(r.cuts for r in reports) == 0
    # Four are for what the residual takes from energy and momenta, at most; 5 would do without.
    assert max(r.iterations for r in reports) <= 10
    # Forces of rounding, ε E₁, move with the soft half. It was 3e-5 where grown residuals were
    # accepted, and 1.5e-10 to 4e-7, as the processor's last bits decided, where rounding alone
    # ended a step.
    assert H <= 1e-9


@pytest.mark.filterwarnings("ignore:Up to t = .* goes back and forth")  # as it does
@pytest.mark.filterwarnings("ignore:Vibrations of")  # and is damped far beyond them
@pytest.mark.filterwarnings("ignore:simulate. a wave needs")  # at the shortest steps
@pytest.mark.parametrize("dt", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("start", ["kick", "load"])
def test_viscous_stress_far_above_the_elastic_one(dt, start):
    """η/(E Δt) = 1e6: Newton ends at the rounding of viscous forces, which is small."""
    E = 2e11
    how = {
        "load": rf.Traction("x1", (0.0, 0.0, 1e5)),
        "kick": rf.InitialVelocity(function=lambda X: 0.1 * np.outer([0, 0, 1], X[0])),
    }
    effects = [rf.Fixed("x0"), rf.KelvinVoigt(1e6 * E * dt), how[start]]
    steel = rf.StVenantKirchhoff(E=E, nu=0.3, rho=7850.0)
    scene = rf.Scene(rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)), steel, effects)
    reports = list(rf.simulate(scene, dt, 20 * dt))
    off = imbalance(reports)
    show(most=max(r.iterations for r in reports), off=off)
    assert sum(r.cuts for r in reports) == 0
    assert max(r.iterations for r in reports) <= 4
    assert off <= 1e-5  # strains of the load are 1e-12 and less


STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=7800.0)
DT = 1.2e-4  # s; some 25 to a period of the bar's first bending motion
SPIN = rf.InitialVelocity(angular=(100.0, 400.0, 50.0))  # 0.05 rad per step
NEWTON = {"snes_lag_jacobian": 1}  # who says how tangents are used, is obeyed


def test_small_strains_wear_no_tangent_out():
    """Where all iterates but the first are rounding, one of these would be taken for a secant."""
    sheet = rf.box((0, 0, 0), (1, 1, 0.02), (8, 8, 1), cell="hexahedron")
    push = rf.Traction("x1", (0, 0, 1.0), until=0.03)
    effects = [rf.Fixed("x0"), push]
    scene = rf.Scene(sheet, STEEL, effects, element="enhanced")
    reports = list(rf.simulate(scene, 3e-3, 0.18, progress=False))
    assert sum(report.tangents for report in reports) <= 6
    assert all("kept" in report.solver for report in reports[1:])


# Motions ---------------------------------------------------------------------------------------


def _bar(*effects, **options):
    bar = rf.box((0, 0, 0), (1, 0.2, 0.2), (8, 2, 2))
    for name, low, high in (("end", 0.8, 1.1), ("middle", 0.3, 0.6)):
        bar = bar.with_cells(name, lambda x, a=low, b=high: (a < x[0]) & (x[0] < b))
    return rf.Scene(bar, STEEL, effects, probes={"tip": (1, 0.1, 0.1)}, **options)


def _shaken(t):
    return (0.0, 0.0, 1e-3 * np.sin(2e3 * t))


PUSH = rf.Traction("x1", (0.0, 0.0, 2e7), until=6 * DT)
MOTIONS = {
    "clamped": lambda: _bar(rf.Fixed("x0"), PUSH),
    "turning": lambda: _bar(SPIN, PUSH),
    "consistent": lambda: _bar(SPIN, PUSH, mass="consistent"),
    "held in part": lambda: _bar(rf.Fixed("x0", components="x"), PUSH),
    "springs": lambda: _bar(rf.Spring("x0", stiffness=1e7), rf.NumericalDamping(0.02), PUSH, SPIN),
    "pressure": lambda: _bar(rf.Pressure("z0", 1e7, until=10 * DT), SPIN),
    "moved": lambda: _bar(rf.PrescribedMotion("x0", displacement=_shaken)),
    "rigid end": lambda: _bar(rf.Rigid("end"), SPIN, rf.Traction("x0", (0, 0, 2e7), until=6 * DT)),
    "rigid middle": lambda: _bar(rf.Rigid("middle"), SPIN, PUSH, mass="consistent"),
}
STEPS = 30


def follow(name, options, dt=DT):
    return list(rf.simulate(MOTIONS[name](), dt, STEPS * DT, petsc_options=options))


def keep(patch):
    """Have tangents kept however small a scene is."""
    patch.setattr(chord, "DEAR", 0.0)
    patch.setattr(chord, "FULL_UP_TO", 0)
    patch.setattr(chord, "STIFF_FROM", 0.0)


def by_two_levels(patch):
    """Have incomplete factors and a coarse grid solve with them, too."""
    keep(patch)
    patch.setattr(chord, "FACTORS_UP_TO", 0)
    patch.setattr(chord, "SLENDER_UP_TO", 0)
    patch.setattr(two_levels, "NODES", 8)


@pytest.fixture
def _keeping(monkeypatch):
    keep(monkeypatch)


@pytest.mark.usefixtures("_keeping")
@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.filterwarnings("ignore:Spring on:rigidfx.RigidfxWarning")
@pytest.mark.filterwarnings("ignore:.* acts with a jolt")
def test_the_motion_is_that_of_newtons_method(name):
    kept, newton = follow(name, {}), follow(name, NEWTON)
    assert newton[-1].tangents == newton[-1].iterations
    assert all(r.solver.startswith("kept") for r in kept[1:])
    tangents = sum(r.tangents for r in kept)
    tips = [np.array([r.probes["tip"] for r in run]) for run in (kept, newton)]
    apart = np.abs(tips[0] - tips[1]).max() / np.abs(tips[1]).max()
    H = [column(run, "energy")[12:] for run in (kept, newton)]
    J = [column(run, "angular_momentum")[12:] for run in (kept, newton)]
    show(tangents=tangents, apart=apart, H=drift(H[0]), J=drift(J[0]))
    assert tangents <= 0.6 * STEPS  # which cost two iterations each
    assert apart <= 1e-11
    for mine, other in ((H[0], H[1]), (J[0], J[1])):
        assert drift(mine) <= 2 * drift(other) + 2e-14


@pytest.mark.usefixtures("_keeping")
def test_a_change_of_the_time_step_is_followed():
    changed = {0.0: DT, 8 * DT: 1.05 * DT, (8 + 8 * 1.05) * DT: 2 * DT}
    kept, newton = (follow("clamped", options, changed) for options in ({}, NEWTON))
    assert column(kept, "t") == pytest.approx(column(newton, "t"), rel=1e-12)
    assert kept[-1].probes["tip"] == pytest.approx(newton[-1].probes["tip"], rel=1e-10)
    by_dt = [[r.tangents for r in kept[1:] if r.dt == pytest.approx(f * DT)] for f in (1, 1.05, 2)]
    assert by_dt[1][0] == 0  # near enough
    assert by_dt[2][0] >= 1


@pytest.mark.usefixtures("_keeping")
def test_what_fails_is_left_to_newtons_method(monkeypatch):
    """No step is cut that Newton's method can take."""

    def useless(self, pc, r, z):
        r.copy(z)

    monkeypatch.setattr(KeptTangent, "apply", useless)
    reports = follow("turning", {})
    assert not any(r.solver.startswith("kept") for r in reports)
    assert max(r.cuts for r in reports) == 0
    newton = follow("turning", NEWTON)
    assert reports[-1].probes["tip"] == pytest.approx(newton[-1].probes["tip"], rel=1e-10)


@pytest.mark.parametrize("options", [{"ksp_type": "preonly", "pc_type": "lu"}, NEWTON])
@pytest.mark.usefixtures("_keeping")
def test_who_chooses_a_solver_is_obeyed(options):
    reports = follow("clamped", options)
    assert all(r.tangents == r.iterations for r in reports)


def test_a_needle_in_long_steps_keeps_no_tangent():
    """By kept factors it turned about its axis: 8e-4 of its energy were lost in 500 steps."""
    needle = rf.Scene(
        rf.box((0, 0, 0), (1, 1e-3, 1e-3), (12, 1, 1)),
        STEEL,
        [rf.InitialVelocity(angular=(5.0, 0.5, 1.0))],
        order=2,
    )
    reports = list(rf.simulate(needle, 0.02, 1.0))
    assert not any(r.solver.startswith("kept") for r in reports)
    H, J = (column(reports, name) for name in ("energy", "angular_momentum"))
    show(H=drift(H), J=drift(J))
    assert max(drift(H), drift(J)) <= 1e-11


def test_a_reduced_part_beside_many_cells_keeps_tangents():
    """Some 90 unknowns, but each tangent condenses cells of 225 dofs for the columns of shapes."""
    bar = rf.box((0, 0, 0), (0.8, 0.4, 0.4), (8, 4, 4))
    bar = bar.with_cells("body", lambda x: x[0] >= 0.2 - 1e-9)
    scene = rf.Scene(bar, STEEL, [rf.Fixed("x0"), PUSH, rf.Reduced("body", shapes=8)])
    *_, last = rf.simulate(scene, DT, 4 * DT)
    assert last.unknowns == 89
    assert last.solver.startswith("kept")


@pytest.mark.parallel
def test_several_ranks_move_as_one():
    one, several = histories(), parallel.run(__file__, 3, 300)
    for name, found in several.items():
        assert np.abs(np.array(found) - one[name]).max() <= 1e-11 * np.abs(one[name]).max()


def histories():
    out = {}
    with pytest.MonkeyPatch.context() as patch:
        keep(patch)
        for name in ("turning", "rigid middle"):
            out[name] = _history(name)
        by_two_levels(patch)
        out["two levels"] = _history("held in part")
    return out


def _history(name):
    reports = follow(name, {})
    assert sum(r.tangents for r in reports) <= 0.6 * STEPS
    return [[r.kinetic, r.strain, *r.angular_momentum] for r in reports]


if __name__ == "__main__":
    parallel.report(histories())

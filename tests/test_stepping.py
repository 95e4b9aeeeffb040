"""Steps: where they end, how they are cut, how far they turn, how their systems are solved."""

import re
import warnings

import numpy as np
import pytest
from histories import EPS, NEWTON, column, drift, tumbling
from hypothesis import given, settings
from hypothesis import strategies as st

import rigidfx as rf
from rigidfx.base.errors import SceneError, StepError

MATERIAL = rf.NeoHooke(rho=1.0, E=100.0, nu=0.3)


def _bar(*effects, cells=(4, 1, 1), material=MATERIAL, **options):
    return rf.Scene(rf.box((0, 0, 0), (4, 1, 1), cells), material, effects, **options)


def _overloaded(*effects):
    """A load beyond all bounds from t = 0.25 s on. (Neo-Hooke would get over it.)"""
    load = rf.Traction("x1", (1e20, 0.0, 0.0), since=0.25)
    return _bar(load, *effects, material=rf.StVenantKirchhoff(rho=1.0, E=100.0, nu=0.3))


# Where steps end --------------------------------------------------------------------------------


def _times(scene, dt, t_end):
    reports = list(rf.simulate(scene, dt, t_end))
    assert [r.step for r in reports] == list(range(len(reports)))
    t = column(reports, "t")
    assert np.abs(np.diff(t) - column(reports, "dt")[1:]).max() <= 4 * EPS * t_end
    return t


def test_steps_end_on_the_grid_and_at_the_end():
    """At k Δt, not at sums of Δt; the last step is shorter where Δt does not divide the end."""
    expected = [*(0.1 * k for k in range(11)), 1.03]
    assert np.array_equal(_times(_bar(), 0.1, 1.03), expected)
    assert np.array_equal(_times(_bar(), 0.1, 0.05), [0.0, 0.05])
    assert np.array_equal(_times(_bar(), 0.1, 0.3), [0.0, 0.1, 0.2, 0.3])


@settings(max_examples=15)
@given(
    kinks=st.lists(st.floats(0.01, 1.2), min_size=1, max_size=4, unique=True).map(sorted),
    dt=st.floats(0.06, 0.5),
)
def test_steps_end_at_every_breakpoint(kinks, dt):
    """Grid and breakpoints, both exactly, and nothing else."""
    table = rf.Table(kinks, [1.0] * len(kinks))
    t = _times(_bar(rf.Gravity(time=table), cells=(1, 1, 1)), dt, 1.0)
    close = 1e-9 * dt
    wanted = [*(k for k in kinks if k < 1.0), *(k * dt for k in range(int(1 / dt) + 1)), 1.0]
    for w in wanted:
        assert np.abs(t - w).min() <= close
    for found in t:
        assert np.abs(np.array(wanted) - found).min() <= close
    assert all(k in t for k in kinks if k < 1.0)


def test_breakpoint_next_to_the_grid_makes_no_tiny_step():
    """A breakpoint that is a grid point but for rounding is one instant, not two."""
    t = _times(_bar(rf.Gravity(since=0.1 + 0.2, until=0.7 + 1e-13)), 0.1, 1.0)
    assert len(t) == 11
    assert np.diff(t).min() > 0.099


# Cutting ----------------------------------------------------------------------------------------


def _violent():
    """A neo-Hookean bar that collapses within half a step; Newton cannot follow at once."""
    squeeze = rf.InitialVelocity(
        function=lambda X: -8.0 * np.array([X[0] - 2, 0.3 * X[1] * X[0], 0 * X[2]])
    )
    return _bar(squeeze)


def test_step_that_does_not_converge_is_cut():
    """The run goes on in shorter steps, gets back to the grid and has lost nothing."""
    reports = list(rf.simulate(_violent(), 0.2, 2.0))
    assert max(r.cuts for r in reports) > 0
    t = column(reports, "t")
    for k in range(11):
        assert np.abs(t - 0.2 * k).min() <= 4 * EPS * 2
    assert any(r.dt == pytest.approx(0.2) for r in reports[2:])  # the cut does not last
    assert drift(column(reports, "energy")) <= 1e-10
    assert drift(column(reports, "linear_momentum")) <= 1e-10


def test_step_that_never_converges():
    """It ends in an error that names the time and the place."""
    with pytest.raises(StepError) as caught:
        list(rf.simulate(_overloaded(rf.Fixed("x0")), 0.1, 1.0))
    message = str(caught.value)
    assert "from t = 0.25 s" in message
    assert "X = (4, " in message  # on the loaded face


def test_state_before_a_failed_step_is_kept():
    """The error leaves the last accepted state as it was."""
    reports = rf.simulate(_overloaded(rf.Gravity()), 0.1, 1.0)
    last = next(r for r in reports if r.t == 0.25)
    u = last.state.u.x.array.copy()
    with pytest.raises(StepError):
        next(reports)
    assert last.state.t == 0.25
    assert np.array_equal(last.state.u.x.array, u)


# Newton and the linear solver -------------------------------------------------------------------


def test_newton_converges_quadratically():
    """Steps of the tumbling L take three iterations; each squares the residual, or nearly."""
    scene = tumbling(rf.StVenantKirchhoff(rho=10.0, E=1e4, nu=0.3))
    *_, last = rf.simulate(scene, 0.1, 3.0, petsc_options={"snes_lag_jacobian": 1})
    r = np.array(last.residuals) / last.residuals[0]
    assert last.iterations <= 4
    assert r[2] <= 10 * r[1] ** 2


def _final(*options, cells=(16, 4, 4)):
    """End state of a bar above the size for which a factorisation is the default."""
    kick = rf.InitialVelocity(function=lambda X: 0.3 * np.outer([0, 1, 0.5], X[0].round(9)))
    *_, last = rf.simulate(_bar(rf.Fixed("x0"), kick, cells=cells), 0.1, 0.5)
    return last.state.u.x.array.copy(), last


def test_krylov_falls_back_to_a_factorisation(monkeypatch, petsc_options):
    """Where GMRES gives up, steps are solved directly and the answer is the same."""
    monkeypatch.setattr("rigidfx.linear.linear_solver.DIRECT_BELOW", 0)
    petsc_options["snes_lag_jacobian"] = 1  # no kept factors
    u, usual = _final()
    assert usual.solver.startswith("gmres")
    petsc_options["ksp_max_it"] = 1
    u_direct, fallen = _final()
    assert "fall-back" in fallen.solver or fallen.solver.startswith("preonly+lu")
    assert np.abs(u_direct - u).max() <= 1e3 * NEWTON * np.abs(u).max()


def test_first_fall_back_is_reported(monkeypatch, petsc_options):
    """In the very step in which it happens."""
    monkeypatch.setattr("rigidfx.linear.linear_solver.DIRECT_BELOW", 0)
    petsc_options["ksp_max_it"] = 1
    kick = rf.InitialVelocity(function=lambda X: 0.3 * np.outer([0, 1, 0.5], X[0].round(9)))
    reports = rf.simulate(_bar(rf.Fixed("x0"), kick, cells=(16, 4, 4)), 0.5, 2.0)
    next(reports)
    first = next(reports)
    reports.close()
    assert "fall-back from Krylov" in first.solver
    assert "lu" in first.solver


def test_newtons_tolerance_is_an_option(petsc_options):
    """-rigidfx_snes_rtol is the reduction of the residual that ends a step."""
    usual = list(rf.simulate(tumbling(MATERIAL), 0.1, 6.0))
    petsc_options["snes_rtol"] = 1e-4
    loose = list(rf.simulate(tumbling(MATERIAL), 0.1, 6.0))
    reduction = np.array([r.residuals[-1] / r.residuals[0] for r in loose[1:]])
    assert reduction.max() <= 1e-4
    assert sum(r.iterations for r in loose) < sum(r.iterations for r in usual)


def test_newtons_patience_is_an_option(petsc_options):
    """-rigidfx_snes_max_it is the number of iterations after which a step is cut."""
    petsc_options["snes_max_it"] = 1
    with pytest.raises(StepError):
        list(rf.simulate(_violent(), 0.2, 2.0))


def test_options_of_others_are_left_alone(petsc_options):
    """rigidfx reads its own prefix only, and leaves nothing in PETSc's database."""
    from petsc4py import PETSc

    everything = PETSc.Options()
    everything["ksp_type"] = "richardson"
    before = dict(everything.getAll())
    try:
        _, last = _final(cells=(4, 1, 1))
        assert last.solver == "preonly+lu"
        assert dict(everything.getAll()) == before
    finally:
        everything.delValue("ksp_type")


def test_run_that_is_left_early():
    """A generator may be closed, or forgotten, at any time; the next run is not disturbed."""
    for _ in range(20):
        reports = rf.simulate(_bar(rf.Gravity()), 0.1, 1.0)
        next(reports)
        next(reports)
        reports.close()
    reports = list(rf.simulate(_bar(rf.Gravity()), 0.1, 1.0))
    assert reports[-1].t == 1.0


def test_probes():
    """Points inside cells are interpolated; points outside are refused."""
    spin = np.array([0.0, 0.0, 0.1])
    points = {"node": (4.0, 1.0, 1.0), "inside": (1.3, 0.2, 0.7), "middle": (2.0, 0.5, 0.5)}
    scene = _bar(rf.InitialVelocity(angular=tuple(spin)), probes=points)
    *_, last = rf.simulate(scene, 1e-4, 1e-4)
    for name, point in points.items():
        # One short step: u = Δt ω × X to second order in ω Δt = 1e-5.
        expected = 1e-4 * np.cross(spin, np.array(point) - [2, 0.5, 0.5])
        assert np.abs(last.probes[name] - expected).max() <= 1e-9
    whole = rf.box((0, 0, 0), (1, 1, 1), (49, 1, 1))  # it ends at 1 - 1e-16
    at_end = rf.Scene(whole, rf.NeoHooke(E=1.0, nu=0.3, rho=1.0), probes={"end": (1, 1, 0)})
    assert [*at_end.probe_cells] == ["end"]
    with pytest.raises(SceneError, match="lies in no cell"):
        rf.simulate(_bar(probes={"far": (9.0, 0.0, 0.0)}), 0.1, 1.0)


DT = 0.1


def spinning(omega, *effects, cells=(2, 1, 1)):
    """A free bar that turns about z, its tip watched."""
    domain = rf.box((-1, -0.5, -0.5), (1, 0.5, 0.5), cells).with_cells("all", lambda X: X[0] < 9)
    start = rf.InitialVelocity(linear=(50.0, 0, 0), angular=(0, 0, omega))
    material = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1.0)
    return rf.Scene(domain, material, [start, *effects], probes={"mid": (0, 0, 0), "x": (1, 0, 0)})


def turned(reports):
    """Angle by which the tip has turned in the first step [rad]."""
    first = reports[1].probes
    x = first["x"] - first["mid"] + (1, 0, 0)
    return float(np.arctan2(x[1], x[0]))


@pytest.mark.parametrize("effects", [(), (rf.Rigid("all"),)], ids=["flexible", "rigid"])
@pytest.mark.parametrize("angle", [1.2, 20.0])
def test_a_large_rotation_is_warned_of_once(effects, angle):
    with pytest.warns(rf.RigidfxWarning, match="rad per step") as shown:
        reports = list(rf.simulate(spinning(angle / DT, *effects), DT, 5 * DT))
    mine = [str(w.message) for w in shown if "rad per step" in str(w.message)]
    assert len(mine) == 1
    assert ("body 'all'" in mine[0]) == bool(effects)
    told = re.search(
        r"by ([\d.e+]+) rad per step .*instead, ([\d.]+) rad.* Δt ≤ ([\d.e-]+) s", mine[0]
    )
    assert told is not None
    found, instead, fine = map(float, told.groups())
    assert found == pytest.approx(angle, rel=0.02)
    assert instead == pytest.approx(2 * np.arctan(angle / 2), rel=0.01)
    assert turned(reports) == pytest.approx(instead, rel=0.02)
    # With the Δt that it names the motion is right to 1 %, and nothing is said.
    reports = list(rf.simulate(spinning(angle / DT, *effects), fine, 2 * fine))
    assert turned(reports) == pytest.approx(angle / DT * fine, rel=0.01)


def test_a_body_that_turns_too_far_for_some_steps_is_warned_of():
    """It spins up and down between two looks at flexible cells: bodies are looked at always."""
    torque = rf.Table((0.0, 2 * DT, 4 * DT, 6 * DT), (1.0, 1.0, -1.0, 0.0))
    couple = rf.Resultant("all", torque=(0, 0, 100.0), time=torque)
    with pytest.warns(rf.RigidfxWarning, match="body 'all' turns at .* rad per step"):
        reports = list(rf.simulate(spinning(0.0, rf.Rigid("all"), couple), DT, 7 * DT))
    assert len(reports) == 8


def test_the_angle_is_that_of_the_fastest_part():
    """One of two bars that turn against each other, so that the whole has no angular momentum."""
    domain = rf.box((0, 0, 0), (5, 1, 1), (5, 1, 1))

    def turning(X):
        left = np.where(X[0] < 2.5, 1.0, -1.0)
        y = X - np.stack([np.where(X[0] < 2.5, 1.0, 4.0), 0 * X[0] + 0.5, 0 * X[0] + 0.5])
        return np.cross((0.0, 0.0, 40.0), (left * y).T).T

    soft = rf.StVenantKirchhoff(E=1e2, nu=0.0, rho=1.0)
    scene = rf.Scene(domain, soft, [rf.InitialVelocity(function=turning)])
    with pytest.warns(rf.RigidfxWarning, match="cell . of the mesh around"):
        list(rf.simulate(scene, DT, DT))


@pytest.mark.parametrize("angle", [0.05, 0.9])
def test_moderate_rotations_pass(angle):
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        list(rf.simulate(spinning(angle / DT), DT, 5 * DT))


def test_fast_vibration_is_no_rotation():
    """Steps of a hundred periods: velocities are high, increments small."""
    bend = rf.InitialVelocity(
        function=lambda X: np.stack([0 * X[0], 0 * X[0], 40 * (X[0] + 1) ** 2])
    )
    domain = rf.box((-1, -0.5, -0.5), (1, 0.5, 0.5), (4, 2, 2))
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1.0), [rf.Fixed("x0"), bend])
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        warnings.filterwarnings("ignore", ".*goes back and forth")
        reports = list(rf.simulate(scene, DT, 5 * DT))
    assert reports[-1].kinetic > 0

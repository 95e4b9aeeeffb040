"""Full factors of soft parts follow from how long tangents serve, by counts alone."""

from __future__ import annotations

import numpy as np
import pytest

import rigidfx as rf
from rigidfx.step.newton.long_kept import MAKING, OFTEN, SOLVING, LongKept

FILL = 6.0


def _rule(fill=FILL):
    return LongKept(lambda: fill)


def _serve(rule, steps, newton=5, linear=14, first=True):
    """A tangent that serves for so many steps; how many until the choice changes."""
    before = rule.full
    for k in range(steps):
        rule.served(newton, linear, first and k == 0)
        if rule.full != before:
            return k + 1
    return None


def test_a_tangent_that_serves_long_gets_full_factors():
    rule = _rule()
    assert _serve(rule, 1000) == -(-OFTEN * MAKING * FILL // 14)


def test_one_that_does_not_keeps_incomplete_ones():
    rule, steps = _rule(), int(OFTEN * MAKING * FILL / 14)
    for _ in range(100):
        assert _serve(rule, steps) is None


def test_full_factors_whose_solves_take_as_long_are_not_made():
    as_many = 5 * SOLVING * FILL
    assert _serve(_rule(), 1000, linear=0.9 * as_many) is None
    assert _serve(_rule(), 1000, linear=1.1 * as_many) is not None


def test_entries_are_not_asked_for_without_need():
    rule = LongKept(lambda: pytest.fail("asked"))
    assert _serve(rule, 1000, newton=10, linear=2) is None
    assert _serve(rule, 2) is None


def test_factors_that_do_not_repay_are_given_up_and_tried_later():
    rule = _rule()
    first = _serve(rule, 1000)
    _serve(rule, 2, newton=4, linear=4)
    rule.served(4, 4, True)  # the tangent has served two steps only
    assert not rule.full
    assert _serve(rule, 1000) == pytest.approx(2 * first, abs=1)
    _serve(rule, 100, newton=4, linear=4)
    rule.served(4, 4, True)  # this one a hundred
    assert rule.full


def test_factors_that_spare_no_iterations_are_given_up_however_long_they_serve():
    for newton, stays in ((4, True), (6, False)):
        rule = _rule()
        _serve(rule, 1000)
        _serve(rule, 100, newton=newton, linear=newton)
        rule.served(newton, newton, True)
        assert rule.full == stays


def test_factors_by_mumps_are_given_up_at_once_and_for_good():
    rule = _rule()
    _serve(rule, 1000)
    rule.served(4, 4, True, dear=True)
    assert not rule.full
    assert _serve(rule, 1000) is None


def test_a_division_goes_on_where_the_one_before_was():
    first, second, third = _rule(), _rule(FILL / 2), _rule()
    _serve(first, 1000)
    second.go_on(first)  # no tangent has ended
    assert second.full
    assert _serve(second, 2, newton=4, linear=4) is None
    second.served(4, 4, True)
    assert not second.full  # it has served two steps only
    third.go_on(second)
    assert _serve(third, 1000) == pytest.approx(2 * _serve(_rule(), 1000), abs=1)


def test_one_whose_factors_were_mumpss_tells_nothing():
    first, second = _rule(), _rule()
    _serve(first, 1000)
    first.served(4, 4, True, dear=True)
    second.go_on(first)
    assert _serve(second, 1000) is not None


def test_a_cantilever_of_rubber_comes_to_full_factors_and_to_the_same_motion():
    rubber = rf.StVenantKirchhoff(E=1e6, nu=0.45, rho=1100.0)

    def run(*effects, **options):
        box = rf.box((0, 0, 0), (0.3, 0.1, 0.1), (9, 8, 8))
        effects = rf.Fixed("x0"), rf.Traction("x1", (0, 0, 20.0)), *effects
        scene = rf.Scene(box, rubber, effects)
        _, *reports = rf.simulate(scene, 1.2e-3, 45 * 1.2e-3, progress=False, **options)
        return reports[-1].energy, [report.solver for report in reports]

    energy, solvers = run()
    assert solvers[0] == "kept fgmres+ilu"
    assert solvers[-1].startswith("kept preonly+")
    _, divided = run(rf.MassDamping(1e-9, until=40 * 1.2e-3))
    assert divided[39:] == solvers[39:]  # another division has them from its first step on
    by_newton, _ = run(petsc_options={"snes_lag_jacobian": 1})
    assert energy == pytest.approx(by_newton, rel=1e-10)


def test_what_is_left_of_a_stiff_structure_keeps_full_factors():
    """A stalk whose stiff block freezes; by GMRES it took twice the iterations."""
    box = rf.box((0, 0, 0), (8, 1, 1), (32, 4, 4))
    box = box.with_cells("stalk", lambda x: x[0] <= 4 + 1e-9)
    box = box.with_cells("block", lambda x: x[0] >= 4 - 1e-9)
    soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
    effects = rf.Fixed("x0"), rf.Gravity(), rf.MassDamping(1.0)

    def solvers(*more, **options):
        scene = rf.Scene(box, {"stalk": soft, "block": stiff}, [*effects, *more])
        _, *reports = rf.simulate(scene, 0.02, 0.4, progress=False, **options)
        return [report.solver for report in reports]

    rule = rf.StrainRate(1e9, 0.2, never=["stalk"], wake="none")
    before, *_, after = solvers(rigidify=rule)
    assert before.startswith("kept preonly+")
    assert after.startswith("kept preonly+")
    assert solvers(rf.Rigid("block"))[0] == "kept fgmres+ilu"  # which knows nothing of it


def test_what_was_found_outlasts_a_division_that_keeps_no_tangents():
    """All of a bar freezes, and is released: its next step has the factors that had been earned."""
    soft = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
    box = rf.box((0, 0, 0), (8, 1, 1), (32, 4, 4))
    effects = [
        rf.Fixed("x0"),
        rf.Traction("x1", (0, 0, 60.0), time=lambda t: np.sin(2 * np.pi * t / 3)),
        rf.MassDamping(6.0),
    ]
    rule = rf.StrainRate(1e9, 0.2, since=1.6, wake="none", release=rf.Release(at=2.0))
    run = rf.simulate(rf.Scene(box, soft, effects), 0.02, 2.04, rigidify=rule, progress=False)
    _, *reports = run
    at = next(k for k, report in enumerate(reports) if report.unknowns == 6)
    assert reports[0].solver == "kept fgmres+ilu"
    assert reports[at - 1].solver.startswith("kept preonly+")
    assert reports[at].solver == "preonly+lu"
    assert reports[-1].unknowns == 2400
    assert reports[-1].solver == reports[at - 1].solver

"""Releases that let cells down: a stress that fades, a freeze that is undone, kinks at a freeze.

Run as a script under mpirun, this file reports a history with all of that.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.errors import SceneError
from rigidfx.decide.decision import Decision, PlannedBody
from rigidfx.decide.policy import CHECKED, STEEPEST, Easing
from rigidfx.mechanics.eased import Eased
from rigidfx.preparation import prepare
from rigidfx.scene.timeline import Timeline
from rigidfx.step.system.supports import supports_of
from rigidfx.switch.inventory import divide

DT, WINDOW = 0.02, 20  # s, steps
SOFT, STIFF = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
HYPERELASTIC = rf.NeoHooke(E=1e6, nu=0.3, rho=1000.0)


def box(cell="hexahedron", cells=(6, 2, 2)):
    domain = rf.box((0, 0, 0), (3, 1, 1), cells, cell, comm=MPI.COMM_SELF)
    return domain.with_cells("end", lambda x: x[0] <= 1 + 1e-9)


def middles(mesh):
    return mesh.geometry.x[cell_geometry_dofs(mesh)].mean(axis=1)


def bind_anew(run):
    """Have the equations know what is eased."""
    stepper, acting = run.stepper, run.switch.acting
    state = stepper.state
    division = divide(stepper.scene, stepper.forces, state, supports_of(acting), [])
    stepper.bind(replace(division, bodies=state.bodies), acting)


def begun(scene, t_end, span, by=0.02):
    """A run at whose start the half x ≥ 1.5 is to fade from a shape of its own; its cells."""
    run, _ = prepare(scene, Timeline(DT, t_end))
    state, space = run.stepper.state, scene.space
    cells = np.flatnonzero(middles(scene.mesh)[:, 0] > 1.5).astype(np.int32)
    nodes = np.unique(space.dofmap.list[cells]).astype(np.int32)
    shape = state.u.x.array.reshape(-1, 3)[nodes]
    X = state.X[nodes]
    further = by * np.stack([X[:, 1] ** 2, X[:, 2] * X[:, 0], -(X[:, 0] ** 2) / 3], axis=1)
    state.ease(Eased(cells, nodes, shape, shape + further, 0.0, span))
    bind_anew(run)
    return run, cells


def let_down(scene, t_end, span):
    """Measures and work of easing of each step of such a run."""
    run, _ = begun(scene, t_end, span)
    state, found = run.stepper.state, []
    with run:
        found.append((run.stepper.measure(), 0.0))
        while state.t < t_end - DT / 2:
            result, _ = run.advance(run.target())
            found.append((run.stepper.measure(), result.dissipated.get("Easing", 0.0)))
    return found


@pytest.mark.parametrize(
    ("cell", "material", "options"),
    [
        ("hexahedron", SOFT, {}),
        ("hexahedron", SOFT, {"mass": "consistent"}),
        ("hexahedron", SOFT, {"element": "enhanced"}),
        ("hexahedron", HYPERELASTIC, {}),
        ("tetrahedron", SOFT, {}),
        ("hexahedron", SOFT, {"order": 2}),
        ("hexahedron", SOFT, {"rigid": True}),
        ("hexahedron", SOFT, {"rigid": True, "mass": "consistent"}),
    ],
)
def test_a_stress_that_fades_moves_no_momentum_and_tells_its_work(cell, material, options):
    rigid = [rf.Rigid("end")] if options.pop("rigid", False) else []
    turning = rf.InitialVelocity(linear=(0.3, 0, 0), angular=(0.2, 0.5, 1.0))
    scene = rf.Scene(box(cell), material, [turning, *rigid], **options)
    found = let_down(scene, 0.8, 0.4)
    first, works = found[0][0], np.array([work for _, work in found])
    assert np.abs(works[:21]).max() > 1e-3 * first.kinetic
    assert not works[21:].any()  # it is over, and no force of a step any more
    for now, taken in zip((m for m, _ in found), np.cumsum(works), strict=True):
        J = np.linalg.norm(first.angular_momentum)
        off = np.linalg.norm(now.linear_momentum - first.linear_momentum)
        assert off <= 1e-12 * first.momentum_scale
        assert np.linalg.norm(now.angular_momentum - first.angular_momentum) <= 1e-12 * J
        assert now.energy + taken == pytest.approx(first.energy, rel=1e-11)


def works(run, steps):
    """What is let down in some steps."""
    results = (run.advance(run.stepper.state.t + DT)[0] for _ in range(steps))
    return [result.dissipated.get("Easing", 0.0) for result in results]


def test_an_attempt_that_is_cut_lets_nothing_go():
    scene = rf.Scene(box(), SOFT, [rf.InitialVelocity(angular=(0.2, 0.5, 1.0))])
    found = []
    for far in (False, True):
        run, _ = begun(scene, 2.0, 0.4)
        with run:
            if far:
                run.stepper.attempt(0.9)  # its middle is later than the end of what fades
            found.append(works(run, 3))
    assert found[1] == pytest.approx(found[0], rel=1e-9)
    assert min(map(abs, found[0])) > 0


def test_what_freezes_again_bears_nothing_any_more():
    scene = rf.Scene(box(), SOFT, [rf.InitialVelocity(angular=(0.2, 0.5, 1.0))])
    run, cells = begun(scene, 2.0, 0.8)
    nodes = np.unique(scene.space.dofmap.list[cells]).astype(np.int32)
    with run:
        assert min(map(abs, works(run, 4))) > 0
        body = PlannedBody(cells, nodes, "part 1", 1)
        run.switch.apply(Decision("freeze", "", (body,), frozenset(), 2))
        assert not any(works(run, 2))
        run.switch.apply(Decision("release", "", (), frozenset(), 2))
        assert not any(works(run, 2))


@pytest.mark.filterwarnings("ignore:Vibrations of")  # so damped that there are none
def test_what_is_let_down_does_not_ring():
    """A bar in its weight, held straight by the stress of its bend: cut it swings by all of that.

    Let down over T it swings by |cos ωT/2|/((ωT/π)² - 1) of it, 1/15 after two periods.
    """
    weight = rf.Fixed("x0"), rf.Gravity((0, 0, -0.01))
    scene = rf.Scene(box(), SOFT, [*weight, rf.MassDamping(20.0)])
    *_, last = rf.simulate(scene, 0.1, 20.0, progress=False)
    bent = last.state.u.x.array.reshape(-1, 3).copy()
    free = rf.Scene(box(), SOFT, [*weight])
    period, largest = float(rf.periods(free, 1)[0]), np.abs(bent).max()
    swings = {}
    for span in (1e-9, 2 * period):
        run, _ = prepare(free, Timeline(period / 50, 3.5 * period))
        state = run.stepper.state
        nodes, cells = np.arange(len(bent), dtype=np.int32), np.arange(24, dtype=np.int32)
        state.ease(Eased(cells, nodes, np.zeros_like(bent), bent, 0.0, span))
        bind_anew(run)
        away = []
        with run:
            while state.t < 3.5 * period - 1e-9:
                run.advance(run.target())
                away.append(np.abs(state.u.x.array.reshape(-1, 3) - bent).max() / largest)
        swings[span], start = max(away[-50:]), away[0]
    assert swings[1e-9] >= 0.9
    assert swings[2 * period] == pytest.approx(1 / 15, rel=0.05)
    assert start >= 0.999  # and begins where it was


def pulse(t):
    return float(3.0 < t < 3.3) * np.sin(np.pi * (t - 3.0) / 0.3) ** 2


def struck(comm=MPI.COMM_SELF):
    """A stiff block on a soft stalk, struck sideways."""
    domain = rf.box((0, 0, 0), (8, 1, 1), (16, 2, 2), comm=comm)
    domain = domain.with_cells("stalk", lambda x: x[0] <= 4 + 1e-9)
    domain = domain.with_cells("block", lambda x: x[0] >= 4 - 1e-9)
    blow = rf.Traction("y1", (0, 0, 400.0), time=pulse)
    effects = [rf.Fixed("x0"), blow, rf.MassDamping(2.0)]
    probes = {"tip": (8, 0.5, 0.5)}
    return rf.Scene(domain, {"stalk": SOFT, "block": STIFF}, effects, probes=probes)


@pytest.mark.filterwarnings("ignore:StrainRate. bodies are:rigidfx.RigidfxWarning")
@pytest.mark.filterwarnings("ignore:Body 'part 1'. 16%:rigidfx.RigidfxWarning")
def test_energy_is_told_where_a_run_lets_cells_down():
    rule = rf.StrainRate(0.0, 1e9)
    reports = rf.simulate(struck(), DT, 4.0, rigidify=rule, progress=False)
    tol = 0.01 * max(float(report.strain_rate.max()) for report in reports)
    taken = {}
    for easing in (0.0, None):
        rule = rf.StrainRate(tol, WINDOW * DT, easing=easing)
        reasons, reports = set(), []
        for report in rf.simulate(struck(), DT, 6.0, rigidify=rule, progress=False):
            reports.append(report)
            reasons |= {event.reason for event in report.events}
        assert CHECKED in reasons
        taken[easing] = sum(report.dissipated.get("Easing", 0.0) for report in reports)
        given = sum(r.work_of_loads - sum(r.dissipated.values()) for r in reports)
        assert reports[-1].energy == pytest.approx(given, rel=1e-9)
    assert taken[None] > 0
    assert taken[0.0] == 0


def test_the_time_in_which_a_stress_fades():
    assert Easing(0.25).span(0.4, 0.02, 0.0) == pytest.approx(0.1)
    assert 12 < STEEPEST * 8.0 < 13
    assert Easing(0.25).span(0.4, 0.02, 8.0) == pytest.approx(13 * 0.02)
    assert Easing(0.25).span(0.4, 0.02, 8.0 * (1 + 1e-6)) == Easing(0.25).span(0.4, 0.02, 8.0)
    assert Easing(0.25).span(0.4, 0.02, 1e3) == 0.4
    assert Easing(0.25).span(np.inf, 0.02, 8.0) == 0.0
    assert Easing(0.0).span(0.4, 0.02, 8.0) == 0.0
    none = np.empty(0, dtype=np.int32)
    eased = Eased(none, none, np.empty((0, 3)), np.empty((0, 3)), 1.0, 0.5)
    assert [eased.part(t) for t in (1.0, 1.25, 1.5, 9.0)] == pytest.approx([1, 0.5, 0, 0])
    assert not eased.over(1.49)
    assert eased.over(1.5)


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan, "long"])
def test_bad_easing_is_named(value):
    with pytest.raises(SceneError, match="easing"):
        rf.StrainRate(1e-3, 0.4, easing=value)


@pytest.mark.parametrize("wake", ["all", "none"])
def test_easing_goes_with_local_waking_only(wake):
    assert rf.StrainRate(1e-3, 0.4, wake=wake).easing == 0.0
    with pytest.raises(SceneError, match="easing says how cells are let down"):
        rf.StrainRate(1e-3, 0.4, wake=wake, easing=0.5)


@pytest.mark.filterwarnings("ignore:Body 'part 1'. 16%:rigidfx.RigidfxWarning")
def test_steps_that_are_shortened_twice_wake_what_is_struck():
    control = rf.StepControl(0.01, "tip", largest=0.05)
    rule = rf.StrainRate(6e-4, WINDOW * DT)
    reports = rf.simulate(struck(), control, 3.5, rigidify=rule, progress=False)
    assert any(event.kind == "release" for report in reports for event in report.events)


def history(comm):
    """A struck block that freezes, and is let down: tips, works and events."""
    tips, told = [], []
    rule = rf.StrainRate(6e-4, WINDOW * DT)
    for report in rf.simulate(struck(comm), DT, 5.0, rigidify=rule, progress=False):
        tips.append([*report.probes["tip"], report.dissipated.get("Easing", 0.0)])
        told += [[e.t, e.reason, len(e.changes), e.unknowns_after] for e in report.events]
    return tips, told


@pytest.mark.parallel
@pytest.mark.filterwarnings("ignore:StrainRate. bodies are:rigidfx.RigidfxWarning")
@pytest.mark.filterwarnings("ignore:Body 'part 1'. 16%:rigidfx.RigidfxWarning")
def test_three_ranks_let_the_same_down():
    """One of them has but quiet cells, another one what just moves by rounding."""
    tips, told = parallel.run(__file__, 3, 300)
    alone, events = history(MPI.COMM_SELF)
    assert told == events
    assert len(events) >= 3
    assert np.abs(np.array(tips) - alone).max() <= 1e-9 * np.abs(alone).max()


if __name__ == "__main__":
    warnings.simplefilter("ignore", rf.RigidfxWarning)
    found = history(MPI.COMM_WORLD)
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(found)

"""Rigid while loads act: what forces on bodies would strain, and what they wake.

Run as a script under mpirun, this file reports histories with wakes.
"""

import warnings
from functools import cache

import numpy as np
import parallel
import pytest
from bench.waking_scenes import SOFT, stalk_and_block
from bench.waking_scenes import scene as of_bar
from histories import between

import rigidfx as rf
from rigidfx.flexible.nodal_stress import NodalStress
from rigidfx.growth.growth import OUTGROWN

DT, WINDOW = 0.02, 20  # s, steps
NOTHING = rf.StrainRate(0.0, 1e9)  # nothing qualifies; rates are measured

chatter = pytest.mark.filterwarnings("ignore:StrainRate. bodies are:rigidfx.RigidfxWarning")


def sine(t):
    return np.sin(2 * np.pi * t / 4.0) * min(1.0, t / 4.0)


def blow(t):
    return float(1.0 < t < 1.2) * np.sin(np.pi * (t - 1.0) / 0.2) ** 2


def bar(*effects, **options):
    """A bar of 16 × 1 × 1 cells: a soft stalk, clamped, and what is on it."""
    cell = options.pop("cell", "hexahedron")
    box = stalk_and_block(options.pop("cells", (16, 1, 1)), 4.0, cell)
    if options.pop("pieces", False):
        box = box.with_cells("first", between(4, 5))
        box = box.with_cells("last", lambda x: x[0] >= 7 - 1e-9)
        ends = [box.find(name, (3,), "test").entities for name in ("first", "last")]
        box = box.with_cell_set("pieces", np.concatenate(ends))
    return of_bar(box, *effects, **options)


def on_a_block(*effects, **options):
    """The bar under a gentle sine, and more."""
    push = rf.Traction("x1", (0, 0, 200.0), time=sine)
    return bar(rf.Fixed("x0"), push, rf.MassDamping(1.0), *effects, **options)


STRIKES = {
    "traction": rf.Traction("z1", (0, 0, -3000.0), time=blow),
    "pressure": rf.Pressure("z1", 3000.0, time=blow),
    "gravity": rf.Gravity((0, 0, -3.0), time=blow),
}


# On a bar in free flight.
PUSHES = rf.Traction("z1", (0, 0, -300.0), time=blow), rf.Traction("x1", (0, 90.0, 0), time=blow)


def run(scene, t_end, rule=NOTHING):
    """Tips, strain rates of the cells, which of them are rigid, and events."""
    tips, rates, rigid, events = [], [], [], []
    for report in rf.simulate(scene, DT, t_end, rigidify=rule, progress=False):
        tips.append(report.probes["tip"])
        rates.append(report.strain_rate.copy())
        rigid.append(report.state.body_numbers() > 0)
        events += report.events
    return np.array(tips), np.array(rates), np.array(rigid), events


def local(tol, **options):
    return rf.StrainRate(tol, WINDOW * DT, wake="local", **options)


def error(tips, twin):
    return np.abs(tips - twin).max() / np.abs(twin - twin[0]).max()


@cache
def gentle():
    """The twin of the bar under the sine, and a tolerance of a hundredth of its peak rate."""
    twin = run(on_a_block(), 6.0)
    return twin, 0.01 * twin[1].max()


def test_a_block_stays_rigid_while_a_slow_load_acts():
    (tips, *_), tol = gentle()
    found, _, rigid, events = run(on_a_block(), 6.0, local(tol))
    assert rigid.mean() >= 0.45  # of the half that could be
    assert error(found, tips) <= 3e-3
    assert events[0].kind == "freeze"


@pytest.mark.parametrize("tol", [0.0, rf.Relative(0.02)], ids=["zero", "relative"])
def test_what_is_at_rest_is_rigid_until_it_is_struck(tol):
    """With a tolerance of nothing yet: it strains by rounding, which wakes nothing."""
    push = rf.Traction("x1", (100.0, 30.0, 0.0), since=20 * DT, until=22 * DT)
    *_, rigid, events = run(bar(push), 22 * DT, rf.StrainRate(tol, 3 * DT, wake="local"))
    assert [event.kind for event in events] == ["freeze", "release"]
    assert events[0].t == pytest.approx(9 * DT)  # seven steps for the price of its switches
    assert events[1].t == pytest.approx(20 * DT)
    assert events[1].reason == OUTGROWN
    assert rigid[10:20].all()


def test_what_falls_is_rigid_by_a_relative_tolerance():
    """It strains by what the end of Newton's method leaves."""
    rule = rf.StrainRate(rf.Relative(0.01), 3 * DT)
    *_, rigid, events = run(bar(rf.Gravity((0, 0, -9.81))), 20 * DT, rule)
    assert [event.kind for event in events] == ["freeze"]
    assert rigid[-1].all()


def test_a_stiff_head_that_rang_for_a_moment_stays_rigid():
    """Of the energy of the arm's swing it has a thousandth, however fast it rang."""
    box = rf.box((0, 0, 0), (10, 1, 1), (10, 1, 1))
    box = box.with_cells("arm", lambda x: x[0] < 5.01).with_cells("head", lambda x: x[0] > 4.99)
    arm, head = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (2e7, 2e9))
    kick = rf.Traction("x1", (0, 0, 2e3), until=0.5)
    effects = [rf.Fixed("x0"), kick, rf.NumericalDamping(0.02)]
    scene = rf.Scene(box, {"arm": arm, "head": head}, effects, order=2)
    rule = rf.StrainRate(1e-3, 5.0, wake="local")
    (freeze,) = (e for r in rf.simulate(scene, 0.05, 12.0, rigidify=rule) for e in r.events)
    assert [change.cells_after for change in freeze.changes] == [5]


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_load_that_begins_as_a_part_freezes_moves_it_in_the_step(mass):
    """By shapes, to which it comes in the same step, and later by cells that wake."""
    push = rf.Traction("x1", (100.0, 30.0, 0.0), since=9 * DT)
    scene = bar(push, mass=mass)
    tips, *_ = run(scene, 30 * DT)
    found, *_, events = run(
        scene, 30 * DT, rf.StrainRate(1e-9, 3 * DT, wake="local", until=10 * DT)
    )
    assert events[0].kind == "freeze"
    assert events[0].t == pytest.approx(9 * DT)
    assert {event.reason for event in events[1:]} == {OUTGROWN}
    assert error(found, tips) <= 5e-4


@chatter
def test_the_papers_rule_releases_it_at_each_change_of_the_load():
    _, tol = gentle()
    *_, rigid, events = run(on_a_block(), 4.0, rf.StrainRate(tol, WINDOW * DT, wake="all"))
    assert rigid.mean() <= 0.1
    assert {event.reason for event in events if event.kind == "release"} == {
        "Traction on 'x1' changes"
    }


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("traction", {}),
        ("pressure", {"mass": "consistent"}),
        (
            "gravity",
            {"cell": "tetrahedron", "order": 2, "mass": "consistent", "cells": (8, 1, 1)},
        ),
    ],
    ids=["lumped", "consistent", "tetrahedra"],
)
@chatter
def test_a_blow_wakes_what_it_strains(kind, options):
    """Or bodies get shapes that follow it; momenta and energy are kept."""
    scene = on_a_block(STRIKES[kind], **options)
    tips, rates, _, _ = run(scene, 1.4)
    tol = 0.05 * rates.max()
    found, _, rigid, events = run(scene, 1.4, local(tol))
    assert rigid[round(0.9 / DT)].any()
    woken = [event.t for event in events if event.woken.size]
    assert min(woken, default=1.0) >= 1.0 - 1e-9
    for event in events:
        assert event.linear_momentum_error <= 1e-10
        assert abs(event.energy_lost) <= 1e-10
    asleep = run(scene, 1.4, rf.StrainRate(tol, WINDOW * DT, wake="none"))
    assert error(found, tips) <= 0.01 * error(asleep[0], tips)


def test_a_wave_wakes_the_half_that_it_runs_into():
    push = rf.Traction("x1", (-3000.0, 0, 0), time=blow)
    scene = bar(rf.Fixed("x0"), push, rf.MassDamping(0.1), block=SOFT)
    tips, rates, _, _ = run(scene, 2.0)
    tol = 0.004 * rates.max()
    found, _, rigid, events = run(scene, 2.0, local(tol))
    assert rigid[round(0.9 / DT)].mean() > 0.9
    assert any(event.woken.size for event in events)
    assert error(found, tips) <= 5e-3
    asleep = run(scene, 2.0, rf.StrainRate(tol, WINDOW * DT, wake="none"))
    assert error(asleep[0], tips) >= 0.1


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@chatter
def test_momenta_and_energy_are_kept_at_each_release(mass):
    """To 1e-12 of what there is, from the largest so far: a support takes none of them."""
    scene = bar(rf.InitialVelocity(linear=(1.0, 0, 0)), *PUSHES, block=SOFT, mass=mass)
    largest, found = np.zeros(3), []
    tol = 0.05 * run(scene, 1.6)[1].max()
    rule = local(tol, release=rf.Release(at=1.3))  # of a body that vibrates by its shapes
    for report in rf.simulate(scene, DT, 1.6, rigidify=rule, progress=False):
        now = report.energy, report.momentum_scale, np.linalg.norm(report.angular_momentum)
        largest = np.maximum(largest, now)
        for event in report.events:
            errors = event.energy_lost, event.linear_momentum_error, event.angular_momentum_error
            found += [np.abs(errors) / largest] if event.kind == "release" else []
    assert len(found) >= 1
    assert np.max(found) <= 1e-12


POINTS = {"stalk": (1, 0.5, 1), "root": (4.2, 0.5, 1), "block": (5, 0.5, 1)}


def under_weight(probes=POINTS, **options):
    """The bar under the sine, bent from the start on: its block freezes with a stress."""
    weight = rf.Traction("x1", (0, 100.0, 0))
    return on_a_block(weight, rf.Preload([weight]), probes=probes, **options)


@pytest.mark.parametrize(
    "options",
    [{}, {"mass": "consistent", "cell": "tetrahedron", "order": 2}],
)
def test_stresses_at_nodes_and_probes_are_those_of_the_twin(options):
    """Under a load slower than the part, with the stress that it froze with."""
    scene = under_weight(**options)
    nodal, inside = NodalStress(scene), scene.space.tabulate_dof_coordinates()[:, 0] > 4 + 1e-9

    def stresses(rule):
        """At probes and nodes."""
        for report in rf.simulate(scene, DT, 4.0, rigidify=rule, progress=False):
            if report.step in range(100, 201, 20):
                report.state.rebuild()
                shown = nodal.measure(report.state.u, report.recovered())[1, inside, :6]
                yield report.stresses, shown

    def apart(a, b):
        """Mean difference, relative to the mean size of the latter."""
        a, b = (np.reshape(x, (-1, np.shape(x)[-1] // 3, 3)) for x in (a, b))
        size = [np.linalg.norm(x, axis=(1, 2)).mean() for x in (a - b, b)]
        return size[0] / size[1]

    _, tol = gentle()
    found, twin = list(stresses(local(tol))), list(stresses(NOTHING))
    for name in ("stalk", "root", "block"):
        at, exact = ([s[name].stress for s, _ in run] for run in (found, twin))
        assert apart(at, exact) <= 0.01
    shown, exact = ([s for _, s in run] for run in (found, twin))
    assert apart(shown, exact) <= 0.01


@chatter
def test_what_rings_down_wakes_little_in_vain():
    """All becomes quiet; what is left at the support has to take the motion of all."""
    push = rf.Traction("y1", (0, 0, 400.0), time=lambda t: blow(0.2 + t))
    scene = bar(rf.Fixed("x0"), push, rf.MassDamping(2.0))
    tips, rates, _, _ = run(scene, 6.0)
    tol = 0.01 * rates.max()
    found, _, rigid, events = run(scene, 6.0, local(tol))
    woken = [(round(event.t / DT), event.woken) for event in events if event.woken.size]
    ahead = [rates[k : k + 2 * WINDOW, cells].max(axis=0) for k, cells in woken]
    assert sum((rate <= tol).sum() for rate in ahead) <= 4
    windows = rates[1:].reshape(-1, WINDOW, rates.shape[1]).max(axis=1)
    assert rigid.mean() >= 0.6 * (windows <= tol).mean()
    assert error(found, tips) <= 0.8 * 3 * 0.01


@pytest.mark.parametrize(("where", "windows"), [(2.0, 1), (7.0, 3)])
def test_small_parts_wait_longer_than_large_ones(where, windows):
    box = rf.box((0, 0, 0), (8, 1, 1), (16, 2, 2))
    box = box.with_cells("end", lambda x: x[0] >= where - 1e-9)
    swings = rf.InitialVelocity(function=lambda x: np.stack([0 * x[0], 0 * x[0], 1e-3 * x[0]]))
    scene = rf.Scene(box, SOFT, [rf.Fixed("x0"), swings])
    rule = rf.StrainRate(0.0, WINDOW * DT, tolerances={"end": 1e9}, wake="local")
    events = [
        (round(event.t / (WINDOW * DT)), event.kind)
        for report in rf.simulate(scene, DT, 4 * WINDOW * DT, rigidify=rule, progress=False)
        for event in report.events
    ]
    assert events == [(windows, "freeze")]


@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
def test_named_parts_may_be_watched_where_nothing_qualifies():
    """No cell may strain at all, for as long as nobody knows how long."""
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (2, 1, 1)).with_cells("left", lambda x: x[0] < 0.6),
        SOFT,
        [rf.Rigid("left")],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        *_, last = rf.simulate(scene, DT, 4 * DT, rigidify=rf.StrainRate(0.0, "auto", wake="local"))
    assert last.t == pytest.approx(4 * DT)


def test_what_is_at_rest_has_no_period():
    """Nothing oscillates where nothing moves."""
    scene = bar(rf.Rigid("block"))
    *_, rigid, events = run(scene, 20 * DT, rf.StrainRate(1e-6, "auto", wake="local"))
    assert [e.kind for e in events] == ["freeze"]
    assert rigid[-1].mean() == 15 / 16  # but for cells between it and the part that is named


# Several ranks ---------------------------------------------------------------------------------


def history():
    """Tips and events of the bar that is struck, by a consistent mass."""
    scene = on_a_block(STRIKES["traction"], mass="consistent")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tips, _, _, events = run(scene, 1.4, local(2e-4))
    told = [
        [e.t, e.kind, [[c.name, c.cells_before, c.cells_after] for c in e.changes]] for e in events
    ]
    return [tips.tolist(), told]


@pytest.mark.parallel
def test_several_ranks_wake_as_one():
    (tips, told), (others, events) = history(), parallel.run(__file__, 3, 300)
    assert any(kind == "release" for _, kind, _ in told)
    # A shape that a body gets a step earlier or later is a static response: it makes 1e-5.
    assert np.abs(np.array(others) - tips).max() <= 1e-4 * np.abs(tips).max()
    assert [event[1:] for event in events] == [event[1:] for event in told]
    assert [event[0] for event in events] == pytest.approx([event[0] for event in told])


if __name__ == "__main__":
    parallel.report(history())

"""Rigid while loads act: what forces on bodies would strain, and what they wake.

Run as a script under mpirun, this file reports histories with wakes.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import parallel
import pytest
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.errors import SceneError, StepError
from rigidfx.decide.clusters import CellGraph
from rigidfx.decide.criteria.concentration import quiet_enough
from rigidfx.decide.enclosed import round_enclosed
from rigidfx.decide.memory import bends, deflection
from rigidfx.decide.memory.bends import Bends
from rigidfx.decide.memory.drift import Drift
from rigidfx.decide.memory.rise import Rise
from rigidfx.decide.memory.strokes import Strokes
from rigidfx.decide.memory.work import SWITCHES, too_dear
from rigidfx.decide.reasons import CHECKED, FORESEEN
from rigidfx.flexible.nodal_stress import NodalStress
from rigidfx.flexible.stress import CauchyStress
from rigidfx.scene.sample import spread
from rigidfx.shadow import pace, response
from rigidfx.shadow.dashpots import of_neighbours
from rigidfx.shadow.gauge import UNSETTLED
from rigidfx.shadow.hanging import Hanging
from rigidfx.shadow.linear_part import LinearPart
from rigidfx.shadow.pace import LONG, LOOKS, Pace
from rigidfx.shadow.parts import Parts
from rigidfx.shadow.response import Response
from rigidfx.shadow.shadow import Shadow
from rigidfx.shadow.withheld import Withheld
from rigidfx.step.watches.judge import Judge

COMM = MPI.COMM_WORLD
DT, WINDOW = 0.02, 20  # s, steps
NOTHING = rf.StrainRate(0.0, 1e9)  # nothing qualifies; rates are measured
SOFT, MIDDLING, STIFF = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e7, 1e8))

chatter = pytest.mark.filterwarnings("ignore:StrainRate. bodies are:rigidfx.RigidfxWarning")


def sine(t):
    return np.sin(2 * np.pi * t / 4.0) * min(1.0, t / 4.0)


def blow(t):
    return float(1.0 < t < 1.2) * np.sin(np.pi * (t - 1.0) / 0.2) ** 2


def bar(*effects, block=STIFF, **options):
    """A bar of 16 × 1 × 1 cells: a soft stalk, clamped, and what is on it."""
    box = rf.box(
        (0, 0, 0), (8, 1, 1), options.pop("cells", (16, 1, 1)), options.pop("cell", "hexahedron")
    )
    box = box.with_cells("stalk", lambda x: x[0] <= 4 + 1e-9)
    box = box.with_cells("block", lambda x: x[0] >= 4 - 1e-9)
    materials = {"stalk": SOFT, "block": block}
    if options.pop("pieces", False):
        box = box.with_cells("first", lambda x: (x[0] >= 4 - 1e-9) & (x[0] <= 5 + 1e-9))
        box = box.with_cells("last", lambda x: x[0] >= 7 - 1e-9)
        ends = [box.find(name, (3,), "test").entities for name in ("first", "last")]
        box = box.with_cell_set("pieces", np.concatenate(ends))
    probes = options.pop("probes", {"tip": (8, 0.5, 0.5)})
    return rf.Scene(box, materials, effects, probes=probes, **options)


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
    twin = run(on_a_block(), 8.0)
    return twin, 0.01 * twin[1].max()


def test_a_block_stays_rigid_while_a_slow_load_acts():
    (tips, *_), tol = gentle()
    found, _, rigid, events = run(on_a_block(), 8.0, local(tol))
    assert rigid.mean() >= 0.45  # of the half that could be
    assert error(found, tips) <= 3e-3
    assert events[0].kind == "freeze"


class _Shape:
    """A state whose nodes are where they are put."""

    def __init__(self, x, X):
        self.x, self.X = x, X

    def positions(self, nodes):
        return self.x[nodes]


class _Counted(_Shape):
    """It counts, too, how many nodes are asked for."""

    asked = 0

    def positions(self, nodes):
        self.asked += len(nodes)
        return super().positions(nodes)


def test_parts_bend_by_what_no_rigid_motion_explains():
    """Of u = z x² on 1 m, but for the chord that fits best, 1/6 is left at the ends."""
    scene = rf.Scene(rf.box((0, 0, 0), (1, 0.02, 0.02), (16, 1, 1)), SOFT)
    X = scene.space.tabulate_dof_coordinates()
    every, free = np.arange(scene.owned_nodes), np.zeros(3 * scene.owned_nodes, dtype=bool)
    turn, small = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]]), 1e-4
    bent = X + small * X[:, :1] ** 2 * [0, 0, 1]
    found = Bends(scene)
    assert found.limits(np.ones(1)) is None  # nothing has moved
    for x in (X, X @ turn.T + [5.0, 0, 0], bent @ turn.T):
        found.add(_Shape(x, X), free)
    found.look(2.0, 1e-9)
    first = every[X[every, 0] < 0.51]
    whole, half, _ = found.swings([every, first, every[:0]])
    assert whole == pytest.approx(small / 6, rel=0.15)  # by masses, which are less at the ends
    assert half == pytest.approx(small / 24, rel=0.15)
    assert found.limits(np.ones(1)) == pytest.approx(whole / 2)
    # The most of each body counts, of what is in none nothing.
    found.add_up(np.array([0.5, 0.25, 9.0, 0.5]), np.array([3, 3, -1, 0]))
    assert found.together == 1.0
    found.add_up(None, np.zeros(4, dtype=np.int64))
    assert found.together == 0.0
    # Of what is held at one end the deflection is the displacement itself.
    held, end = Bends(scene), np.repeat(X[:, 0] < 1e-9, 3)
    for x in (X, bent):
        held.add(_Shape(x, X), end)
    held.look(2.0, 1e-9, steps=10 * bends.FAST)
    assert held.per_rate == pytest.approx(small / 2)
    assert held.swing() == pytest.approx(small)
    # What flies turns as a whole, and goes farther than it deflects.
    assert found.swing() == pytest.approx(whole, rel=0.1)
    rates = np.array([0.01, 0.2, 2.0])
    assert found.limits(rates) == pytest.approx(found.per_rate * rates)
    # .01 of it; no more than .02; and what the rate amounts to in a tenth of the time.
    assert held.limits(rates) == pytest.approx(np.array([0.005, 0.02, 0.1]) * small)


def test_few_nodes_stand_for_all_of_a_fine_mesh(monkeypatch):
    """Spread along the bar, likewise of those that are held, they tell the same deflection."""
    scene = rf.Scene(rf.box((0, 0, 0), (1, 0.02, 0.02), (80, 1, 1)), SOFT)
    X = scene.space.tabulate_dof_coordinates()
    monkeypatch.setattr(deflection, "NODES", 32)
    monkeypatch.setattr(deflection, "HELD", 1)
    state, fixed = _Counted(X + 1e-4 * X[:, :1] ** 2, X), np.zeros((len(X), 3), dtype=bool)
    fixed[X[:, 0] < 1e-9] = True
    found = Bends(scene)
    found.add(state, fixed.reshape(-1))
    found.look(2.0, 1e-9)
    assert state.asked <= 32 + 3
    assert found.per_rate == pytest.approx(np.sqrt(3) * 1e-4 / 2, rel=0.1)
    every = spread(scene.comm, X, 32)
    assert np.diff(np.sort(X[every, 0])).max() < 0.06


def test_drift_is_half_the_share_of_power_and_dies_down_with_the_motion():
    found, rigid = Drift(COMM, 2), np.array([False, False])
    found.limit = 0.1
    found.window_ends(np.array([1.0, 4.0]), rigid, 1.0, 0.1, 1.0, 1.0)
    assert (found.rate, found.share) == (0.0, 0.0)
    # Half of 1/5, for a second of 10 rad: as much as the motion itself.
    assert found.room(0.1, free=True) == pytest.approx(0.1 / 5)
    assert found.room(0.1, free=False) == pytest.approx(0.1)  # what a structure gives way less by
    assert found.room_to_go == np.inf
    found.driven = 0.02  # for how far it goes
    assert found.room_to_go == pytest.approx(0.02)
    rigid = np.array([True, False])
    found.window_ends(np.array([0.0, 4.0]), rigid, 1.0, 0.1, 0.1, 1.1)
    assert found.share == pytest.approx(0.2)
    assert found.rate == pytest.approx(0.1)
    assert found.room(0.1, free=True) == pytest.approx(0.0)
    assert found.too_far  # as much again in the next window
    found.window_ends(np.array([0.0, 1.0]), rigid, 0.5, 0.0, 0.1, 0.0)  # loads change: none drifts
    assert found.rate == pytest.approx(0.05)
    assert not found.too_far
    found.window_ends(np.array([0.0, 1.0]), rigid, 0.5, 0.1, 0.1, 0.02)  # they have just ended
    assert found.rate == pytest.approx(0.05 + 0.5 * 0.2 * 0.5 * 0.2)


def test_drift_counts_no_more_than_bodies_withhold():
    """A share that cells had as a motion began may be far more than they withhold of it later."""
    rates = []
    for withheld, strain in ((0.0, 0.0), (0.5, 10.0), (1.0, 8.0), (10.0, 1.0)):
        drift = Drift(COMM, 2)
        drift.limit, rigid = 1.0, np.array([True, False])
        drift.window_ends(np.array([1.0, 4.0]), ~rigid, 1.0, 0.0, 0.1, 0.0)
        for part in (0.3, 1.0, 0.5):  # the largest of each in a window
            drift.compare(part * withheld, strain * (1.3 - part if withheld == 1 else part))
        drift.window_ends(np.array([0.0, 4.0]), rigid, 1.0, 0.1, 0.1, 1.0)
        rates.append(drift.rate)
    assert rates == pytest.approx([0.1, 0.025, 0.0625, 0.1])


@chatter
def test_what_vibrates_fast_hides_no_slow_motion():
    """A sine at the block's own first frequency: the slow swing it sets off strains hardly at all.

    By strain rates alone most of the bar freezes in the first window, and its tip is half off.
    """
    box = rf.box((4, 0, 0), (8, 1, 1), (8, 1, 1))
    period = float(rf.periods(rf.Scene(box, STIFF), 1)[0])
    push = rf.Traction(
        "x1", (0, 0, 400.0), time=lambda t: np.sin(2 * np.pi * t / period) * min(1.0, t / period)
    )
    dt, steps, scene = period / 20, 100, bar(rf.Fixed("x0"), push, rf.MassDamping(1.0))
    rule = rf.StrainRate(1e-3, WINDOW * dt, wake="local")
    tips, peak = [], 0.0
    for each in (NOTHING, rule):
        path = []
        for report in rf.simulate(scene, dt, steps * dt, rigidify=each, progress=False):
            path.append(report.probes["tip"])
            peak = max(peak, float(report.strain_rate.max()))
        tips.append(np.array(path))
    assert error(tips[1], tips[0]) <= 0.8 * rule.kappa * rule.tol / peak


@pytest.mark.parametrize("tol", [0.0, rf.Relative(0.02)], ids=["zero", "relative"])
def test_what_is_at_rest_is_rigid_until_it_is_struck(tol):
    """With a tolerance of nothing yet: it strains by rounding, which wakes nothing."""
    push = rf.Traction("x1", (100.0, 30.0, 0.0), since=20 * DT, until=22 * DT)
    *_, rigid, events = run(bar(push), 22 * DT, rf.StrainRate(tol, 3 * DT, wake="local"))
    assert [event.kind for event in events] == ["freeze", "release"]
    assert events[0].t == pytest.approx(9 * DT)  # seven steps for the price of its switches
    assert events[1].t == pytest.approx(20 * DT)
    assert events[1].reason.startswith("predicted")
    assert rigid[10:20].all()


def test_what_is_at_rest_takes_no_solves_and_wakes_as_if_it_had(monkeypatch):
    """A resting bar before a blow: its shadow solved for zero, nine times, and then each 16th."""
    push = rf.Traction("x1", (100.0, 30.0, 0.0), since=60 * DT, until=62 * DT)
    rule, runs = rf.StrainRate(1e-4, 3 * DT, wake="local"), []
    increments, solves = LinearPart.increment, []

    def counted(self, *given):
        solves.append(given)
        return increments(self, *given)

    monkeypatch.setattr(LinearPart, "increment", counted)
    for rests in (Response.rests, lambda *_: False):
        monkeypatch.setattr(Response, "rests", rests)
        scene, known = bar(push), []
        for report in rf.simulate(scene, DT, 70 * DT, rigidify=rule, progress=False):
            known.append((report.probes["tip"], [(e.t, e.unknowns_after) for e in report.events]))
            if round(report.t / DT) == 59:
                before = len(solves)
        runs.append((before, known))
        solves.clear()
    (none, resting), (some, solved) = runs
    assert none == 0 < some
    for (tip, events), (same, others) in zip(resting, solved, strict=True):
        assert tip == pytest.approx(same, rel=1e-9, abs=1e-15)
        assert events == others


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
def test_a_load_that_begins_as_a_part_freezes_wakes_it_before_the_step(mass):
    """What the load changes is all that is known of the body, and enough."""
    push = rf.Traction("x1", (100.0, 30.0, 0.0), since=9 * DT)
    scene = bar(push, mass=mass)
    tips, *_ = run(scene, 30 * DT)
    found, *_, events = run(
        scene, 30 * DT, rf.StrainRate(1e-9, 3 * DT, wake="local", until=10 * DT)
    )
    assert [event.kind for event in events] == ["freeze", "release"]
    assert [event.t for event in events] == pytest.approx([9 * DT] * 2)
    assert events[1].reason.startswith("predicted")
    assert error(found, tips) <= 1e-9


@chatter
def test_the_papers_rule_releases_it_at_each_change_of_the_load():
    _, tol = gentle()
    *_, rigid, events = run(on_a_block(), 4.0, rf.StrainRate(tol, WINDOW * DT, wake="all"))
    assert rigid.mean() <= 0.1
    assert {event.reason for event in events if event.kind == "release"} == {
        "Traction on 'x1' changes"
    }


@pytest.mark.parametrize("kind", STRIKES)
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"mass": "consistent"},
        {"cell": "tetrahedron", "order": 2, "mass": "consistent", "cells": (8, 1, 1)},
    ],
    ids=["lumped", "consistent", "tetrahedra"],
)
@chatter
def test_a_blow_wakes_what_it_strains(kind, options):
    """Before it strains what stays rigid by more than twice κ tol, momenta and energy kept."""
    scene = on_a_block(STRIKES[kind], **options)
    tips, rates, _, _ = run(scene, 1.4)
    tol = 0.05 * rates.max()
    found, _, rigid, events = run(scene, 1.4, local(tol))
    (first, *_) = (event for event in events if event.woken.size)
    assert first.kind == "release"
    before = rigid[round(0.9 / DT)]
    assert before.any()
    loud = (rates[round(1.0 / DT) :, before] > 3 * tol).any(axis=1)
    assert 1.0 - 1e-9 <= first.t <= 1.0 + DT * np.argmax(loud) + 1e-9
    blow = slice(round(1.0 / DT), round(1.2 / DT))
    assert not (rigid[blow] & (rates[blow] > 6 * tol)).any()
    for event in events:
        assert event.linear_momentum_error <= 1e-10
        assert abs(event.energy_lost) <= 1e-10
    asleep = run(scene, 1.4, rf.StrainRate(tol, WINDOW * DT, wake="none"))
    assert error(found, tips) <= 0.3 * error(asleep[0], tips)


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


@pytest.mark.parametrize(
    ("mass", "damping"),
    [
        ("lumped", ()),
        ("consistent", ()),
        ("lumped", (rf.StiffnessDamping(ratio=0.02, frequency=2.0),)),
    ],
)
def test_a_shadow_begins_as_a_linear_twin(mass, damping, monkeypatch):
    """All of a free bar freezes while it vibrates: its shadow goes on with the vibration."""

    def shape(x):
        z = np.cos(np.pi * x[0] / 8.0)
        return np.stack([1e-3 * z, 0 * z, 0 * z])

    scene = bar(rf.InitialVelocity(function=shape), *damping, block=SOFT, mass=mass)
    seen = []
    look = Shadow.look

    def watch(self, t, dt, limits):
        strained = look(self, t, dt, limits)
        if strained is not None:
            seen.append((t + dt, strained.rate * limits().rates))
        return strained

    monkeypatch.setattr(Shadow, "look", watch)
    monkeypatch.setattr(pace, "LONG", ())  # no step is left out
    t_end = 1.4
    _, rates, _, _ = run(scene, t_end)
    # Every cell qualifies and none wakes, nor does all bend too much.
    rule = rf.StrainRate(10 * rates.max(), 0.3, wake="local", kappa=2.0)
    run(scene, t_end, rule)
    times, shadows = zip(*seen[1:], strict=True)  # the first look tells nothing by rates
    twin = np.array([rates[round(t / DT)] for t in times])
    strong = twin > 0.3 * twin.max()
    early = np.array(times) < 0.6
    ratio = (np.array(shadows) / np.where(strong, twin, np.nan))[early]
    assert np.isfinite(ratio).sum() > 20
    assert np.nanmin(ratio) >= 0.8
    assert np.nanmax(ratio) <= 1.05


def test_neighbours_take_a_bodys_vibration_as_dashpots_whatever_the_mesh(monkeypatch):
    """Half of a uniform bar rings along its axis: most of that runs out into the other half."""
    found, seen = [], []
    look = Shadow.look

    def watch(self, t, dt, limits):
        strained = look(self, t, dt, limits)
        seen.append((t, float(((strained.rate * limits().rates) ** 2).sum())))
        return strained

    def neighbours(*given):
        found.append(of_neighbours(*given))
        return found[-1]

    def ringing(x):
        # A jump at the border would make waves that neither cells nor steps resolve.
        phase = np.pi * np.maximum(x[0] - 4.0, 0.0) / 4.0
        z = np.sin(phase) ** 2 * np.cos(phase)
        return np.stack([1e-3 * z, 0 * z, 0 * z])

    monkeypatch.setattr(Shadow, "look", watch)
    monkeypatch.setattr(response, "of_neighbours", neighbours)
    monkeypatch.setattr(pace, "LONG", ())  # no step is left out
    rule = rf.StrainRate(1.0, 1e9, wake="local")
    rod = rf.StVenantKirchhoff(E=SOFT.E, nu=0.0, rho=SOFT.rho)
    for cells, t_end in ((8, 1, 1), DT), ((16, 2, 2), 1.0):
        effects = rf.Rigid("block"), rf.InitialVelocity(function=ringing)
        run(bar(*effects, block=rod, cells=cells), t_end, rule)
    coarse, fine = (float(c.sum()) for c in found)
    assert fine == pytest.approx(coarse, rel=1e-12)
    assert 0.5 <= fine / np.sqrt(SOFT.E * SOFT.rho) <= 1.0  # ρcA of a rod
    early, late = (
        np.mean([power for t, power in seen[1:] if a <= t < b]) for a, b in ((0, 0.2), (0.8, 1.0))
    )
    assert late <= 0.1 * early  # three round trips and more


@pytest.mark.parametrize("supports", [("x0", "x1"), ("x0",), ("edge",)])
@pytest.mark.usefixtures("by_shadows")
def test_what_supports_hold_is_held_in_margins(supports, monkeypatch):
    """K⁺ρ of a body whose margins are all the rest is what all the structure would strain."""
    ends, at_rest = [], LinearPart.at_rest

    def watch(self, force):
        found = at_rest(self, force)
        self._set(force)
        self._found.array[:] = found.reshape(-1)
        self._K.mult(self._found, self._work)
        left = np.abs((self._work - self._right).array).reshape(-1, 3).max(axis=1)
        ends.append((np.abs(force).max(), left, np.abs(found).max(axis=1)))
        return found

    monkeypatch.setattr(LinearPart, "at_rest", watch)
    box = rf.box((0, 0, 0), (8, 1, 1), (4, 1, 1)).with_vertices(
        "edge", lambda x: (x[0] < 1e-9) & (x[2] < 1e-9)
    )
    box = box.with_cells("middle", lambda x: (x[0] >= 2 - 1e-9) & (x[0] <= 6 + 1e-9))
    weight = rf.Gravity((0, 0, -1.0), time=lambda t: t)
    scene = rf.Scene(box, SOFT, [*map(rf.Fixed, supports), weight, rf.Rigid("middle")])
    for _ in rf.simulate(
        scene, DT, 5 * DT, rigidify=rf.StrainRate(1.0, 1e9, wake="local"), progress=False
    ):
        pass
    force, left, moved = ends[-1]
    held = moved == 0
    assert held.sum() == sum(2 if name == "edge" else 4 for name in supports)
    assert left[~held].max() <= 1e-6 * force  # nothing else takes a force
    if len(supports) > 1:
        assert left[held].max() >= 1e-2 * force  # clamps do


def under_tension(chosen):
    """A uniform bar, pulled ever more, in which cells are rigid all of whose nodes are chosen."""
    box = rf.box((0, 0, 0), (8, 2, 2), (8, 3, 3), "tetrahedron").with_cells("chosen", chosen)
    pull = rf.Traction("x1", (200.0, 0, 0), time=lambda t: t)
    return rf.Scene(box, SOFT, [rf.Fixed("x0"), pull, rf.MassDamping(20.0), rf.Rigid("chosen")])


@pytest.mark.parametrize(
    ("chosen", "least", "most"),
    [
        (lambda x: x[0] >= 4 - 1e-9, 1.0, 1.15),
        (lambda x: (abs(x[0] - 4.5) < 0.6) & (abs(x[1:] - 1.0) < 0.4).all(axis=0), 2.0, 10.0),
    ],
    ids=["half", "inside"],
)
@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
@pytest.mark.usefixtures("by_shadows")
def test_neighbours_give_way_beside_what_is_told_of_bodies(chosen, least, most, monkeypatch):
    """Cells of few neighbours in a body strain as in the twin, and small parts hold others, too."""
    told, shadows, look = [], [], Shadow.look

    def watch(self, t, dt, limits):
        strained = look(self, t, dt, limits)
        if strained is not None:
            told.append(strained.rate * limits().rates)
            shadows.append(self)
        return strained

    monkeypatch.setattr(Shadow, "look", watch)
    monkeypatch.setattr(pace, "LONG", ())  # no step is left out
    scene = under_tension(chosen)
    run_on = {"dt": DT, "t_end": 1.0, "progress": False}
    own = scene.owned_cells("chosen", "test")
    effects = [effect for effect in scene.effects if not isinstance(effect, rf.Rigid)]
    flexible = rf.Scene(scene.domain, SOFT, effects)
    *_, twin = rf.simulate(flexible, rigidify=NOTHING, **run_on)
    for _ in rf.simulate(scene, rigidify=rf.StrainRate(1.0, 1e9), **run_on):
        pass
    ratio = told[-1][own] / twin.strain_rate[own]
    assert ratio.min() >= 0.75
    assert ratio.max() <= 1.35
    assert least <= shadows[-1].stiffening <= most


def test_drift_counts_what_parts_hold_round_them():
    drifts = []
    for stiffening in 1.0, 2.0:
        drift = Drift(COMM, 4)
        drift.limit, drift.stiffening = 1.0, stiffening
        energy, rigid = np.array([1.0, 3.0, 3.0, 3.0]), np.arange(4) == 0
        drift.window_ends(energy, np.zeros(4, bool), 1.0, 0.1, 1.0, 2.0)
        room = drift.room(0.1, free=True)
        drift.window_ends(np.where(rigid, 0.0, energy), rigid, 1.0, 0.1, 1.0, 3.0)
        drifts.append((drift.rate, room))
    (once, room), (twice, less) = drifts
    assert twice == pytest.approx(2 * once)
    assert less == pytest.approx(room / 2)


@chatter
def test_growth_of_a_body_does_not_wake_it():
    """What the shadow of a body did where it grows would tear the new cells."""
    push = rf.NodalForce("x1", (0, 0, 40.0), time=blow)
    scene = bar(rf.Fixed("x0"), push, rf.MassDamping(3.0), rf.KelvinVoigt(2e4), block=SOFT)
    _, rates, _, _ = run(scene, 6.0)
    *_, events = run(scene, 6.0, local(0.02 * rates.max()))
    grown = [
        event.t
        for event in events
        for change in event.changes
        if 0 < change.cells_before < change.cells_after
    ]
    assert grown
    woken = np.array([event.t for event in events if event.woken.size])
    assert not any((np.abs(woken - t) < 1.5 * DT).any() for t in grown)


@chatter
@pytest.mark.usefixtures("by_shadows")
def test_a_slow_load_wakes_by_what_it_has_withheld():
    """Its rate is below the threshold at all times; its strain grows."""
    push = rf.Traction("x1", (0, 0, 100.0), time=lambda t: t / 20.0)
    scene = bar(rf.Fixed("x0"), push, rf.MassDamping(3.0), block=MIDDLING)
    _, rates, _, _ = run(scene, 10.0)
    tol, block = 1.2 * rates[50:].max(), scene.owned_cells("block", "")
    some = {"block": 1.2 * rates[50:, block].max()}
    _, _, rigid, events = run(scene, 10.0, local(tol, tolerances=some))
    assert rigid[300:, block].any()
    assert any(event.woken.size for event in events if event.t > 6.0)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@chatter
def test_momenta_and_energy_are_kept_at_each_wake(mass):
    """To 1e-12 of what there is, from the largest so far: a support takes none of them."""
    scene = bar(rf.InitialVelocity(linear=(1.0, 0, 0)), *PUSHES, block=SOFT, mass=mass)
    largest, found = np.zeros(3), []
    tol = 0.05 * run(scene, 1.6)[1].max()
    for report in rf.simulate(scene, DT, 1.6, rigidify=local(tol), progress=False):
        now = report.energy, report.momentum_scale, np.linalg.norm(report.angular_momentum)
        largest = np.maximum(largest, now)
        for event in report.events:
            errors = event.energy_lost, event.linear_momentum_error, event.angular_momentum_error
            found += [np.abs(errors) / largest] if event.woken.size else []
    assert len(found) >= 1
    assert np.max(found) <= 1e-12


BLOWS = {
    "traction": rf.Traction("x1", (-3000.0, 0, 0), time=blow),
    "pressure": rf.Pressure("x1", 3000.0, time=blow),
    "window opens": rf.Pressure("x1", 3000.0, since=1.0),
    "window closes": rf.Pressure("x1", 3000.0, until=0.7, time=lambda t: min(0.2 * t, 1.0)),
}


@chatter
@pytest.mark.parametrize("push", BLOWS)
@pytest.mark.usefixtures("by_shadows")
def test_what_loads_change_on_a_body_is_predicted(push):
    """A blow on the body itself wakes it before the step."""
    part, block = (0.02, STIFF) if push == "window closes" else (0.004, SOFT)
    scene = bar(rf.Fixed("x0"), BLOWS[push], rf.MassDamping(0.1), block=block)
    tol = part * run(scene, 1.6)[1].max()
    *_, events = run(scene, 1.6, local(tol))
    reasons = [event.reason for event in events if event.woken.size]
    assert reasons[0] == FORESEEN
    assert set(reasons) <= {FORESEEN, CHECKED}


@chatter
def test_a_wake_in_steps_that_are_cut(monkeypatch):
    """Each step of the blow is objected to until it is half as long."""
    judged = Judge.objection

    def objection(self, attempt):
        if 1.0 - 1e-9 <= attempt.t < 1.1 and attempt.dt > 0.6 * DT:
            return StepError("as told.", "")
        return judged(self, attempt)

    scene = on_a_block(STRIKES["traction"])
    tips, rates, *_ = run(scene, 1.4)
    tol = 0.05 * rates.max()
    monkeypatch.setattr(Judge, "objection", objection)
    found, _, rigid, events = run(scene, 1.4, local(tol))
    assert len(found) >= len(tips) + 5
    assert any(1.0 - 1e-9 <= e.t <= 1.1 for e in events if e.woken.size)
    assert rigid.any(axis=1)[round(0.8 / DT)]
    assert np.abs(found[-1] - tips[-1]).max() <= 0.8 * 3 * 0.05 * np.abs(tips).max()
    for event in events:
        assert abs(event.energy_lost) <= 1e-10


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_stresses_of_rigid_parts_are_those_of_the_twin(mass):
    """Under a load slower than the part, in the mean over its cells and half a period."""
    scene = on_a_block(mass=mass)
    stress = CauchyStress(scene)
    times = range(100, 201, 20)

    def stresses(rule):
        steps = rf.simulate(scene, DT, 4.0, rigidify=rule, progress=False)
        for report in steps:
            if report.step in times:
                found, recovered = rf.recovered_stress(report, stress)
                yield found, stress.measure(report.state.u), recovered.copy()

    twin = [found for found, _, _ in stresses(NOTHING)]
    _, tol = gentle()
    sizes = []
    for (found, kept, recovered), exact in zip(stresses(local(tol)), twin, strict=True):
        assert recovered.sum() >= 7
        differences = found - exact, kept - exact, exact
        sizes += [[np.linalg.norm(s[recovered], axis=(1, 2)).mean() for s in differences]]
    apart, without, whole = np.mean(sizes, axis=0)
    assert apart <= 0.05 * whole
    assert without >= 0.5 * whole


POINTS = {"stalk": (1, 0.5, 1), "root": (4.2, 0.5, 1), "block": (5, 0.5, 1)}


def under_weight(probes=POINTS, **options):
    """The bar under the sine, bent from the start on: its block freezes with a stress."""
    weight = rf.Traction("x1", (0, 100.0, 0))
    return on_a_block(weight, rf.Preload([weight]), probes=probes, **options)


@pytest.mark.parametrize(
    "options",
    [{}, {"mass": "consistent"}, {"mass": "consistent", "cell": "tetrahedron", "order": 2}],
)
def test_stresses_at_nodes_and_probes_are_those_of_the_twin(options):
    """Under a load slower than the part, with the stress that it froze with."""
    scene = under_weight(**options)
    nodal, inside = NodalStress(scene), scene.space.tabulate_dof_coordinates()[:, 0] > 4 + 1e-9

    def stresses(rule):
        """At probes and nodes, as shown and of the freeze; what is said to be recovered."""
        for report in rf.simulate(scene, DT, 4.0, rigidify=rule, progress=False):
            if report.step in range(100, 201, 20):
                report.state.rebuild()
                shown = nodal.measure(report.state.u, report.recovered())[1, inside, :6]
                kept = nodal.measure(report.state.u)[1, inside, :6]
                yield report.stresses, shown, kept

    def apart(a, b):
        """Mean difference, relative to the mean size of the latter."""
        a, b = (np.reshape(x, (-1, np.shape(x)[-1] // 3, 3)) for x in (a, b))
        size = [np.linalg.norm(x, axis=(1, 2)).mean() for x in (a - b, b)]
        return size[0] / size[1]

    _, tol = gentle()
    found, twin = list(stresses(local(tol))), list(stresses(NOTHING))
    for name, carried in (("stalk", False), ("root", True), ("block", True)):
        assert all(at[name].recovered == carried for at, *_ in found)
        assert not any(at[name].recovered for at, *_ in twin)
        at, exact = ([s[name].stress for s, *_ in run] for run in (found, twin))
        assert apart(at, exact) <= 0.05
    shown, kept, exact = ([s[k] for s in run] for run, k in ((found, 1), (found, 2), (twin, 1)))
    assert apart(shown, exact) <= 0.05
    assert 0.1 <= apart(kept, exact) <= 0.9  # there is a part that is frozen, and one that is not


@pytest.mark.usefixtures("by_shadows")
def test_stresses_are_recovered_where_they_are_asked_for(monkeypatch):
    """Not at a probe whose cells are flexible, and by one solve, at most, for all that is asked."""
    asked, solved = [], []
    recovered, at_rest = Shadow.recovered, LinearPart.at_rest

    def counted(self, force):
        before = self._rest
        out = at_rest(self, force)
        solved.append(self._rest is not before)
        return out

    monkeypatch.setattr(Shadow, "recovered", lambda self: asked.append(1) or recovered(self))
    monkeypatch.setattr(LinearPart, "at_rest", counted)
    scene, on_stalk = (on_a_block(probes=p) for p in (POINTS, {"stalk": POINTS["stalk"]}))
    cells, (_, tol) = CauchyStress(scene), gentle()
    for report in rf.simulate(on_stalk, DT, 1.0, rigidify=local(tol), progress=False):
        assert not report.stresses["stalk"].recovered
    assert len(report.bodies) == 1
    assert not asked
    for report in rf.simulate(scene, DT, 1.0, rigidify=local(tol), progress=False):
        assert not asked  # by the step
        solved.clear()
        at, (_, carried) = report.stresses, rf.recovered_stress(report, cells)
        assert sum(solved) <= 1
        assert at["block"].recovered == carried.any() == (report.step > 2 * WINDOW)
        asked.clear()
    after, found = rf.recovered_stress(report, cells)  # the run has ended
    assert np.array_equal(found, carried)
    assert not np.array_equal(after, cells.measure(report.state.u))


def test_series_and_table_mark_what_is_recovered(tmp_path):
    scene = on_a_block(probes=POINTS)
    _, tol = gentle()
    frozen = []
    with rf.Recorder(scene, tmp_path, every=50) as recorder:
        for report in rf.simulate(scene, DT, 1.0, rigidify=local(tol), progress=False):
            recorder.write(report)
            frozen += [report.step for event in report.events if event.kind == "freeze"]
    first, last = ((tmp_path / "fields" / f"fields_{k:06d}.vtu").read_bytes() for k in (0, 1))
    assert b'Name="recovered"' in first
    assert b'Name="recovered"' in last
    table = rf.read_history(tmp_path)
    assert table["recovered_block"].tolist() == [float(k > frozen[0]) for k in range(51)]
    assert not table["recovered_stalk"].any()
    assert table["stress_block_xx"][-1] == report.stresses["block"].stress[0, 0]


@chatter
def test_what_rings_down_wakes_little_in_vain():
    """All becomes quiet; what is left at the support has to take the motion of all."""
    push = rf.Traction("y1", (0, 0, 400.0), time=lambda t: blow(0.2 + t))
    scene = bar(rf.Fixed("x0"), push, rf.MassDamping(2.0))
    tips, rates, _, _ = run(scene, 10.0)
    tol = 0.01 * rates.max()
    found, _, rigid, events = run(scene, 10.0, local(tol))
    woken = [(round(event.t / DT), event.woken) for event in events if event.woken.size]
    ahead = [rates[k : k + 2 * WINDOW, cells].max(axis=0) for k, cells in woken]
    assert sum((rate <= tol).sum() for rate in ahead) <= 4
    windows = rates[1:].reshape(-1, WINDOW, rates.shape[1]).max(axis=1)
    assert rigid.mean() >= 0.6 * (windows <= tol).mean()
    assert error(found, tips) <= 0.8 * 3 * 0.01


def test_the_quietest_parts_freeze_as_long_as_the_rest_can_take_the_motion():
    loud, share = np.array([0.9, 0.1, 0.3]), np.array([1.0, 6.0, 2.0])
    assert quiet_enough(loud, 10.0, share).tolist() == [False, True, False]
    assert quiet_enough(loud, 100.0, share).tolist() == [True, True, True]
    assert quiet_enough(loud, 9.0, share).tolist() == [False, True, False]
    assert quiet_enough(np.zeros(2), 0.0, np.zeros(2)).all()
    assert not quiet_enough(np.array([0.5]), 1.0, np.ones(1)).any()


def test_what_would_be_enclosed_and_is_not_quiet_stays_flexible_with_a_ring():
    scene = rf.Scene(rf.box((0, 0, 0), (5, 5, 5), (5, 5, 5), comm=MPI.COMM_SELF), SOFT)
    corners = scene.mesh.geometry.x[cell_geometry_dofs(scene.mesh)]
    far = np.abs(corners.mean(axis=1) - 2.5).max(axis=1)  # of cells from the middle
    every, loud = np.arange(125, dtype=np.int32), np.where(far < 0.5, 1.6, 0.5)

    def out(criterion, loud):
        return round_enclosed(CellGraph(scene), [every], far > 0.5, loud, criterion.enclosing)

    assert np.array_equal(out(local(1.0), loud), far < 1.5)  # half of κ is 1.5
    assert not out(local(1.0), 0.9 * loud).any()
    assert not out(local(1.0, kappa=4), loud).any()
    assert not out(rf.Accuracy(0.01), loud).any()  # no cell wakes for itself


def test_a_freeze_pays_as_much_work_as_it_costs():
    one, small, large = np.ones(10, dtype=bool), np.array([0], np.int32), np.arange(1, 6)
    quiet = np.full(10, 20.0)
    parts = [small, large.astype(np.int32)]  # a tenth and half of the cells: 2 and 10 steps
    assert np.flatnonzero(too_dear(parts, quiet, one, MPI.COMM_SELF)).tolist() == [0]
    quiet[0] = 10 * SWITCHES
    assert not too_dear(parts, quiet, one, MPI.COMM_SELF).any()


@pytest.mark.parametrize(("where", "windows"), [(2.0, 1), (7.0, 3)])
def test_small_parts_wait_longer_than_large_ones(where, windows):
    box = rf.box((0, 0, 0), (8, 1, 1), (16, 2, 2))
    box = box.with_cells("end", lambda x: x[0] >= where - 1e-9)
    swings = rf.InitialVelocity(function=lambda x: np.stack([0 * x[0], 0 * x[0], 0.1 * x[0]]))
    scene = rf.Scene(box, SOFT, [rf.Fixed("x0"), swings])
    rule = rf.StrainRate(0.0, WINDOW * DT, tolerances={"end": 1e9}, wake="local")
    events = [
        (round(event.t / (WINDOW * DT)), event.kind)
        for report in rf.simulate(scene, DT, 4 * WINDOW * DT, rigidify=rule, progress=False)
        for event in report.events
    ]
    assert events == [(windows, "freeze")]


@pytest.mark.usefixtures("by_shadows")
def test_what_rings_from_step_to_step_or_turns_wakes_nothing(monkeypatch):
    """The midpoint rule has it ring for ever where steps do not resolve it."""
    looks, look = [], Shadow.look

    def seen(self, t, dt, limits):
        found = look(self, t, dt, limits)
        if found is not None and not looks:
            places = np.zeros_like(self._response.motion.u)
            places[self._margin.inside] = self._margin.parts.V
            stretch, turn = 1e-3 * places, np.cross((0, 0, 0.1), places)
            ends, told = [(stretch, stretch), (stretch, -stretch), (turn, turn)], []
            now, first = self._response.motion, self._gauge.looks
            for before, then in [*ends, (0 * stretch, stretch), (0 * stretch, stretch)]:
                self._gauge.looks = first + UNSETTLED * (len(told) == 4)
                end = replace(now, u=now.u + dt * then, w=then)
                told.append(self._gauge.strained(replace(now, w=before), end, dt, limits(), None))
            self._gauge.looks = first
            looks.extend(strained.rate.max() for strained in told)
        return found

    monkeypatch.setattr(Shadow, "look", seen)
    _, tol = gentle()
    run(on_a_block(), 1.0, local(tol))
    steady, ringing, turning, soon, later = looks
    assert steady > 0
    # What begins is told at once, but after a change of bodies in the mean of two steps.
    assert soon == pytest.approx(later / 2)
    assert later == pytest.approx(steady)
    assert ringing <= 1e-9 * steady
    assert turning <= 1e-3 * steady  # its strain is of second order


def test_a_stroke_is_the_largest_strain_over_the_largest_rate():
    found, free = Strokes(COMM, 2), np.zeros(2, dtype=bool)
    found.add(np.array([1e-9, 0.0]), 0.0, 1.0)
    found.look(np.array([1e-9, 0.0]), 1e-8, 0.0, 1.0, free)
    assert found.time == np.inf
    found.add(np.array([0.0, 4.0]), 1.0, 2.0)
    found.look(np.array([2.0, 1.0]), 0.0, 1.0, 2.0, free)
    found.add(np.array([1.0, 0.0]), 2.0, 3.0)
    found.look(np.array([0.5, 0.0]), 0.0, 2.0, 3.0, free)
    assert found.time == 0.5
    assert found.dying == pytest.approx(1 / np.log(4.0))  # from 4 to 1 in a window of 1 s
    assert found.of_strains(0.4) == pytest.approx([0.8, 0.8])  # there and back
    assert found.of_strains(0.6) == pytest.approx([1.0, 1.0])
    assert found.of_strains(0.6, once=True) == pytest.approx([0.5, 0.5])
    found.add(np.array([1.0, 0.0]), 3.0, 4.0)
    found.look(np.array([0.5, 0.0]), 0.0, 3.0, 4.0, free)
    assert found.dying == np.inf


def test_how_a_motion_grows_is_told_by_the_last_half():
    """Of a window, or of the time since it was next to nothing."""
    rise, start, t = Rise(COMM), 0.0, 0.0

    def window(*values):
        nonlocal start, t
        start = t
        for value in values:
            rise.add(value, t, t + 1.0)
            t += 1.0
        return rise.growth(start, t)

    assert Rise(COMM).growth(0.0, 1.0) == 1.0
    assert window(0.1, 0.5, 1.0, 2.0) == 4.0
    assert window(2.0, 3.0, 1.0, 0.1) == 1.5  # what swings goes through zero
    assert window(0.0, 0.1, 0.2, 3.0) == 1.0  # and has been as large
    assert window(3.0, 6.0) == 2.0
    assert window(6.0) == 2.0  # since six of thirteen
    assert window(*[6.0] * 13) == 1.0
    for power in (1.0, 2.0):
        rise, t = Rise(COMM), 0.0
        for ends in (40, 100, 111):  # however short the last window is
            found = window(*[(k + 1.0) ** power for k in range(int(t), ends)])
            assert found == pytest.approx(2.0**power, rel=0.1)


class Beside:
    """A communicator of two, in which the other one gives these numbers."""

    def __init__(self, *others):
        self.others = list(others)

    def allreduce(self, value, op):
        other = self.others.pop(0)
        return max(value, other) if op is MPI.MAX else min(value, other)


def test_a_rank_that_sees_next_to_nothing_does_not_say_since_when():
    """The other one: the largest is 6, it was next to nothing until 3, and 4 at 6.5."""
    rise = Rise(Beside(6.0, 3.0, 4.0))
    rise.add(1e-12, 0.5, 1.0)
    assert rise.growth(9.0, 10.0) == 1.5
    rise = Rise(Beside(1e-12, np.inf, 1e-12))  # and asked of that one
    for t, value in ((1.0, 1e-12), (3.0, 1e-12), (5.0, 4.0), (8.0, 6.0)):
        rise.add(value, t, t + 1)
    assert rise.growth(9.0, 10.0) == 1.5


def test_what_rings_now_is_told_by_the_last_windows():
    """A vibration with ω = 5 turns round in 0.2 s, whatever blow has come before."""
    found, rigid = Strokes(COMM, 2), np.array([False, True])
    cells = np.array([0], dtype=np.int32)
    t = 0.0

    def window(steps, size, omega):
        nonlocal t
        for _ in range(steps):
            t += 0.02
            if found.add(np.array([size * omega * abs(np.cos(omega * t)), 0.0]), t - 0.02, t):
                found.swing(cells, np.array([size * abs(np.sin(omega * t)), 0.0]))
        found.look(np.zeros(2), 0.0, t - steps * 0.02, t, rigid)

    window(50, 1.0, 100.0)
    assert found.seen == pytest.approx(0.01, rel=0.2)
    window(50, 1e-3, 5.0)
    assert found.seen[0] < 0.02  # the blow was in the last window but one
    window(50, 1e-3, 5.0)
    assert found.seen == pytest.approx(0.2, rel=0.1)
    window(50, 1.0, 100.0)
    assert found.seen[0] == pytest.approx(0.01, rel=0.2)
    assert found.seen[1] == pytest.approx(0.2, rel=0.1)  # what is rigid keeps what was seen
    for _ in range(3):
        window(20, 1e-3, 5.0)  # no room for half a period, 0.63 s
    assert found.seen[0] == 0.0
    found.look(np.zeros(2), 1e-6, t, t + 1.0, rigid)  # nothing moves: what was seen holds
    assert found.seen[0] > 0.1


def struck():
    """A bar in flight that is hit for two steps, and then swings with 0.6 Hz."""
    hit = rf.Traction("x1", (-6e4, 0, 3e3), time=lambda t: float(1.0 < t < 1.04))
    return bar(hit, rf.StiffnessDamping(ratio=0.1, frequency=0.6), block=SOFT)


def events_after_a_blow(scene):
    rule = rf.StrainRate(0.017, 1.2, wake="local", kappa=1.5)
    reports = rf.simulate(scene, DT, 4.0, rigidify=rule, progress=False)
    return [event.kind for report in reports for event in report.events]


def test_what_freezes_after_a_blow_lasts(monkeypatch):
    """By the stroke of the blow alone it would wake at once."""
    assert events_after_a_blow(struck()) == ["freeze"]
    monkeypatch.setattr(Strokes, "turning", 0.0)
    monkeypatch.setattr(Bends, "limits", lambda *_: None)  # of what freezes, none bends too much
    assert events_after_a_blow(struck()) == ["freeze", "release"]


@pytest.mark.usefixtures("by_shadows")
def test_cells_spring_within_a_step_however_long_those_of_shadows_are(monkeypatch):
    looks, look = [], Shadow.look

    def seen(self, t, dt, limits):
        if (found := look(self, t, dt, limits)) is not None:
            looks.append((t, found.sum * limits().strains, found.spring * limits().rates * dt))
        return found

    monkeypatch.setattr(Shadow, "look", seen)
    _, tol = gentle()
    run(on_a_block(), 2.0, local(tol))
    times, strains, sprung = map(np.array, zip(*looks, strict=True))
    assert np.diff(times).max() > (min(LONG) - 0.5) * DT  # long steps
    assert strains[-1].max() > 0
    assert sprung == pytest.approx(strains, rel=1e-9, abs=1e-15)


def test_what_swings_within_a_long_step_ends_it_as_it_grows():
    """Of a force with a period of four steps the mean over four is nothing, however much it grows.

    It strains by its size; at three times what it began with, it would wake cells.
    """
    calm, last, told = Pace(), 0.0, 0.0
    for n in range(400):
        size = 0.33 * 1.01 ** max(n - 100, 0)
        if size > 1:
            break
        force = np.full((1, 3), size * np.sin(np.pi * (n / 2 + 0.25)))
        change = abs(float(force[0, 0]) - last)
        last = float(force[0, 0])
        if calm.due(force, 1.0, change):
            told = max(float(np.abs(f).max()) for f, _ in calm.stretches(force, 1.0))
            calm.taken(force, change, told, 0.0)
        else:
            calm.wait(force, 1.0, change)
    assert size > 1
    assert told > 0.5


def test_named_parts_never_wake_but_it_is_said_what_they_withhold():
    scene = on_a_block(STRIKES["traction"], rf.Rigid("block"))
    said = "strain the part 'block' that is named Rigid.* lacks some .*% of its compliance"
    with pytest.warns(rf.RigidfxWarning, match=said):
        *_, rigid, events = run(scene, 1.4, local(1e-4, never="stalk"))
    assert rigid[:, -1].all()
    assert not events


def test_named_parts_that_withhold_little_are_not_spoken_of():
    scene = on_a_block(STRIKES["traction"], rf.Rigid("block"))
    *_, rigid, _ = run(scene, 1.4, local(1.0, min_cells=17))
    assert rigid[:, -1].all()


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_in_free_flight_forces_are_bounded_before_they_are_computed(mass, monkeypatch):
    """A few numbers say that they have hardly changed: all comes out as if they were computed."""
    spin, jump = rf.InitialVelocity(angular=(0.02, 0.1, 0.1)), 50 * DT
    push = rf.Traction("x1", (1000.0, 0, 0), since=jump)
    scene = bar(spin, rf.Gravity(), push, block=SOFT, mass=mass)
    resisted, seen = Withheld.resisted, []

    def counted(self, *given):
        seen[-1][2] += 1
        return resisted(self, *given)

    monkeypatch.setattr(Withheld, "resisted", counted)
    for little in (Pace.little, 0.0):
        monkeypatch.setattr(Pace, "little", little)
        seen.append([[], [], 0])
        rule = rf.StrainRate(5e-3, 5 * DT)
        for report in rf.simulate(scene, DT, 1.2, rigidify=rule, progress=False):
            seen[-1][0] += [(event.t, event.kind) for event in report.events]
            if report.step in (25, 44):
                seen[-1][1].append(report.recovered()[0].x.array - report.state.u.x.array)
    (events, strained, few), (same, exact, every) = seen
    assert events == same
    assert [kind for _, kind in events][:2] == ["freeze", "release"]
    assert events[1][0] == pytest.approx(jump)
    for mine, right in zip(strained, exact, strict=True):
        assert np.abs(mine - right).max() <= 1e-9 * np.abs(right).max()
    assert few <= every / 2


@pytest.mark.parametrize(
    ("tol", "window", "since"),
    [
        (rf.Relative(0.02), WINDOW * DT, 0.0),
        (rf.Relative(0.02), "auto", 0.0),
        (1.6e-5, "auto", 0.0),
        (1.6e-5, WINDOW * DT, 0.8),
    ],
    ids=["relative", "relative and auto", "auto", "late"],
)
def test_named_parts_are_compared_with_what_has_been_seen(tol, window, since):
    """The block strains by .9 % of the stalk's largest rate; at first nobody knows what that is.

    A tolerance that is a part of nothing yet, and a strain that no stroke says what it is worth,
    were exceeded by anything.
    """
    run(on_a_block(rf.Rigid("block")), 1.6, rf.StrainRate(tol, window, since=since, min_cells=17))


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


def test_named_parts_in_pieces_are_not_spoken_of():
    """Nothing tells what one piece exerts on the other."""
    scene = on_a_block(rf.Rigid("pieces", each=False), pieces=True)
    *_, rigid, _ = run(scene, 1.0, local(1.0, never="stalk"))
    assert rigid[:, -1].all()


@pytest.mark.parametrize(
    "held", [None, rf.Fixed("corner"), rf.Symmetry("under")], ids=["none", "corner", "plane"]
)
def test_what_forces_strain_does_not_hang_on_the_rows_that_hold_a_body(held, monkeypatch):
    """K⁺ρ is known to rounding, though nothing holds the margin but the body, and that somehow."""
    found, begin = [], Response.begin

    def solved(self, *arguments):
        force = np.zeros_like(self._margin.parts.V)
        force[:, 2] = self._margin.parts.V[:, 0] ** 2
        self._margin.parts.balance(force)
        found.append((self._margin, force, self.part.strained(force)))
        begin(self, *arguments)

    rows = Parts.held

    def others(self, free):
        """The rows of other nodes hold the bodies."""
        order, self.V = self.V, np.roll(self.V, len(self.V) // 3, axis=0)
        out = rows(self, free)
        self.V = order
        return 3 * ((out // 3 - len(self.V) // 3) % len(self.V)) + out % 3

    monkeypatch.setattr(Response, "begin", solved)
    box = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1)).with_cells("block", lambda x: x[0] >= 4 - 1e-9)
    box = box.with_vertices("corner", lambda x: (abs(x[0] - 3.5) < 1e-9) & (x[1] + x[2] < 1e-9))
    box = box.with_facets("under", lambda x: (x[1] < 1e-9) & (x[0] < 3.6))
    effects = [rf.Rigid("block"), rf.Gravity((0, 0, -1.0)), *([held] if held else [])]
    for choice in (rows, others):
        monkeypatch.setattr(Parts, "held", choice)
        scene = rf.Scene(box, SOFT, effects)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            list(rf.simulate(scene, DT, DT, rigidify=local(1.0), progress=False))
    (margin, force, u), (_, same, again) = found
    assert np.array_equal(force, same)
    assert np.abs(again - u).max() <= 1e-12 * np.abs(u).max()
    assert np.abs(u[margin.outside]).max() > 0


@pytest.mark.filterwarnings("ignore::rigidfx.RigidfxWarning")
def test_what_moves_bodies_as_a_whole_is_taken_out(monkeypatch):
    """Of forces on two bodies whose nodes are numbered in turns, and of displacements."""
    parts, forces, balance = [], [], Parts.balance

    def balanced(self, force):
        balance(self, force)
        parts[:], forces[:] = [self], [force.copy()]

    monkeypatch.setattr(Parts, "balance", balanced)
    box = rf.box((0, 0, 0), (1, 1, 4), (3, 3, 8))
    box = box.with_cells("left", lambda x: x[0] < 0.4).with_cells("right", lambda x: x[0] > 0.6)
    effects = rf.Rigid("left"), rf.Rigid("right"), rf.Traction("z1", (0, 300.0, 20.0), time=blow)
    scene = rf.Scene(box, SOFT, effects)
    list(rf.simulate(scene, DT, 1.2, rigidify=local(1e-9), progress=False))
    (both,), (force,) = parts, forces
    stretched = both.unmoved(both.V * [1.0, 2.0, 3.0])
    turned = both.linear(np.array([[[1.0, 2, 3], [0, 4, 5], [-4, 0, 6], [-5, -6, 0]]] * 2))
    assert np.abs(turned).max() > 1
    assert np.abs(both.unmoved(turned)).max() < 1e-12
    m = scene.nodal_mass[both.rows.nodes, None]
    assert len(both.at) == 2
    for at in both.at:
        assert (np.diff(at) > 1).any()
        for momenta in (force[at], (m * stretched)[at]):
            sums = momenta.sum(axis=0), np.cross(both.V[at], momenta).sum(axis=0)
            assert np.abs(momenta).max() > 1e-3
            assert np.abs(sums).max() < 1e-12 * np.abs(momenta).sum()


def test_what_is_at_rest_has_no_period():
    """Nothing oscillates where nothing moves: shadows divided by the window that this tells."""
    scene = bar(rf.Rigid("block"))
    *_, rigid, events = run(scene, 20 * DT, rf.StrainRate(1e-6, "auto", wake="local"))
    assert [e.kind for e in events] == ["freeze"]
    assert rigid[-1].all()


def paced(rates, withheld=(0.1,)):
    """The pace after looks that have found these, and after one before, which tells no change."""
    out, withheld = Pace(), [*withheld, *(len(rates) - len(withheld)) * withheld[-1:]]
    for rate, other in zip([rates[0], *rates], [withheld[0], *withheld], strict=True):
        out.taken(np.ones((2, 3)), 1.0, rate, other)
    return out


def waited(pace, lengths):
    """How many steps shadows have taken none when they take one."""
    force = np.ones((2, 3))
    for k, dt in enumerate(lengths):
        if pace.due(force, dt, 1.0):
            return k
        pace.wait(force, dt, 1.0)
    raise AssertionError


def test_calm_shadows_take_one_step_in_sixteen():
    """Lengths of steps differ in their last digits, as times at their ends are rounded."""
    most, _ = LONG
    lengths = np.diff(0.02 * np.arange(most + 1))
    assert len(set(lengths.tolist())) > 1
    calm, force = paced(LOOKS * [0.1]), np.ones((2, 3))
    assert waited(calm, lengths) == most - 1
    ((mean, span),) = calm.stretches(force, lengths[-1])
    assert span == pytest.approx(0.02 * most)
    assert (mean == force).all()


@pytest.mark.parametrize(
    ("rates", "withheld", "steps"),
    [
        ([0.5, *(LOOKS - 2) * [0.1]], (0.1,), 0),  # not enough looks
        ([*(LOOKS - 1) * [0.1], 0.8], (0.1,), 0),  # it is too near,
        (LOOKS * [0.1], (*(LOOKS - 1) * [0.1], 0.16), 3),  # comes nearer,
        (LOOKS * [0.1], (*(LOOKS - 1) * [0.1], 0.6), 0),
        ([*(LOOKS // 2) * [0.2, 0.17]], (0.1,), 3),  # or turns faster than 16 steps resolve,
        ([*(LOOKS // 2) * [0.2, 0.1]], (0.1,), 0),  # or 4,
        ([*(LOOKS // 2) * [0.03, 0.01]], (0.1,), 3),  # unless that is little
        (LOOKS * [0.1], (0.9,), 15),  # what adds up and rests may be near
    ],
)
def test_shadows_take_longer_steps_the_less_they_may_miss(rates, withheld, steps):
    assert waited(paced(rates, withheld), 17 * [0.02]) == steps


def test_a_force_that_changes_ends_that_whenever_it_comes():
    for steps in range(max(LONG)):
        alarmed = paced(LOOKS * [0.1])
        for _ in range(steps):
            alarmed.wait(np.ones((2, 3)), 0.02, 1.0)
        assert alarmed.due(np.full((2, 3), 9.0), 0.02, 8.0)
        assert len(alarmed.stretches(np.full((2, 3), 9.0), 0.02)) == steps + 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"wake": "some"}, "wake must be 'all', 'local' or 'none', got 'some'"),
        ({"wake": ["local"]}, "wake must be 'all', 'local' or 'none', got"),
        ({"kappa": 0.5}, "kappa must be ≥ 1, got 0.5"),
        ({"kappa": "3"}, "kappa"),
        ({"kappa": float("nan")}, "kappa"),
    ],
)
def test_is_refused(options, message):
    with pytest.raises(SceneError, match=message):
        rf.StrainRate(1.0, 1.0, **options)


# Several ranks ---------------------------------------------------------------------------------


def beats(t):
    return np.sin(4 * np.pi * t) * min(1.0, 2 * t)


def cases():
    """Scenes, their ends and rules, by name."""
    blows = STRIKES["traction"]
    along = rf.Traction("x1", (200.0, 0, 0), time=beats)
    late = rf.Traction("x1", (-3000.0, 0, 0), time=lambda t: blow(t - 2.4))
    asked = rf.Release(when=lambda report: 0.87 < report.t < 0.89, where="block")
    swing = rf.Traction("x1", (0, 0, 20.0), time=sine)
    thick = {"cells": (16, 2, 2), "probes": {"tip": (8, 0.5, 0.5)}}
    pushes = rf.Traction("z1", (0, 0, -300.0), since=0.5)
    return {
        "lumped": (on_a_block(blows), 1.4, local(2e-4)),
        "consistent": (on_a_block(blows, mass="consistent"), 1.4, local(2e-4)),
        "automatic window": (
            bar(rf.Fixed("x0"), along, late, rf.MassDamping(1.0)),
            3.6,
            rf.StrainRate(4e-5, "auto", wake="local"),
        ),
        # A body grows, wakes again, and is let down.
        "grown": (bar(rf.Fixed("x0"), rf.MassDamping(1.0), swing, **thick), 3.2, local(2e-5)),
        "condition": (on_a_block(blows), 1.2, local(2e-4, release=asked)),
        "support begins": (on_a_block(pushes, rf.Fixed("x1", since=0.5)), 0.7, local(2e-4)),
        "window opens": (on_a_block(rf.Pressure("z1", 3000.0, since=0.5)), 0.7, local(2e-4)),
    }


# Both masses are tried on two and on three ranks, the others on either.
ON_RANKS = {
    2: ("lumped", "consistent", "grown", "condition", "window opens"),
    3: ("lumped", "consistent", "automatic window", "support begins"),
}


@cache
def histories(names):
    """Tips and events of cases, by their names."""
    out, every = {}, cases()
    for name in names:
        scene, t_end, rule = every[name]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tips, _, _, events = run(scene, t_end, rule)
        told = [
            (e.t, e.kind, [(c.name, c.cells_before, c.cells_after) for c in e.changes])
            for e in events
        ]
        out[name] = [tips.tolist(), told]
    return out


def carried():
    """Stresses at probes, and the mean of a nodal one, of what is rigid under a slow load."""
    scene = on_a_block(probes=POINTS)
    nodal = NodalStress(scene)
    for report in rf.simulate(scene, DT, 1.0, rigidify=local(1.5e-5), progress=False):
        at = report.stresses
    u = report.state.u
    owned = nodal.measure(u, report.recovered())[1, : scene.owned_nodes]
    mean = scene.sum(np.abs(owned).sum(axis=0))
    return [[[*s.stress.ravel(), s.recovered] for s in at.values()], mean.tolist()]


def standing():
    """Mean position of the nodes that stand for all: meshes differ in last bits between ranks."""
    scene = rf.Scene(rf.box((0, 0, 0), (3, 1, 0.4), (30, 11, 5)), SOFT)
    X = scene.space.tabulate_dof_coordinates()[: scene.owned_nodes]
    own = X[spread(COMM, X, 100)]
    return (scene.sum(own.sum(axis=0)) / scene.sum(float(len(own)))).tolist()


@pytest.mark.parallel
@pytest.mark.parametrize("ranks", [2, 3])
def test_several_ranks_wake_as_one(ranks):
    assert {*ON_RANKS[2], *ON_RANKS[3]} == cases().keys()
    one, several = histories(tuple(cases())), parallel.run(__file__, ranks, 300)
    for found, exact in zip(several["carried"], carried(), strict=True):
        assert np.abs(np.array(found) - exact).max() <= 1e-8 * np.abs(exact).max()
    assert several["standing"] == pytest.approx(standing(), abs=1e-12)
    for name in ON_RANKS[ranks]:
        tips, told = one[name]
        assert any(kind == "release" for _, kind, _ in told)
        assert np.abs(np.array(several[name][0]) - tips).max() <= 1e-9 * np.abs(tips).max()
        assert [list(map(str, event[1:])) for event in several[name][1]] == [
            list(map(str, [kind, [list(c) for c in changes]])) for _, kind, changes in told
        ]
        assert [event[0] for event in several[name][1]] == pytest.approx([t for t, *_ in told])


if __name__ == "__main__":
    found = histories(ON_RANKS[COMM.size]) | {"standing": standing(), "carried": carried()}
    if COMM.rank == 0:
        parallel.report(found)


# What hangs on a body ----------------------------------------------------------------------------


def leverage(monkeypatch, *effects):
    """How far what hangs on a body is carried that turns by up to 0.01 rad, from 3 m to 6 m [m].

    It is flexible for one window, and rigid from then on; all else never is.
    """
    found, made = [], {}
    begins, carries = Hanging.__init__, Hanging.carried

    def begin(hanging, stepper, parts, held):
        made[id(hanging)] = parts
        begins(hanging, stepper, parts, held)

    def carried(hanging, u):
        parts = made[id(hanging)]
        x = parts.V + parts.bodies[0].origin
        slope = 0.01 * (x[:, 0] - 3.0) / 3.0
        bent = np.zeros_like(u)
        bent[:, 2] = 0.5 * slope * (x[:, 0] - 3.0)
        bent[:, 0] = -slope * (x[:, 2] - 0.5)
        found.append(float(carries(hanging, bent)[0]))
        return carries(hanging, u)

    monkeypatch.setattr(Hanging, "__init__", begin)
    monkeypatch.setattr(Hanging, "carried", carried)
    box = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
    box = box.with_cells("middle", lambda x: (x[0] >= 3 - 1e-9) & (x[0] <= 6 + 1e-9))
    push = rf.Traction("z1", (0, 0, 1e-3), time=sine)
    scene = rf.Scene(box, SOFT, [push, *effects])
    rule = rf.StrainRate(1e-30, 4 * DT, tolerances={"middle": 1e3}, patience=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rf.RigidfxWarning)
        list(rf.simulate(scene, DT, 10 * DT, rigidify=rule))
    return found


@pytest.mark.usefixtures("by_shadows")
def test_what_a_body_carries_is_told_by_its_lever(monkeypatch):
    """Clamped at one end it lifts the other by 15 mm and 2 m · 0.01; at both ends nothing hangs."""
    aside = 0.01 * 0.5  # m, of what is half a metre off the axis
    lifted = pytest.approx(np.hypot(0.015 + 0.01 * 2, aside), rel=1e-3)
    assert leverage(monkeypatch, rf.Fixed("x0"))[-1] == lifted
    assert leverage(monkeypatch, rf.Fixed("x0"), rf.Fixed("x1"))[-1] == 0.0


def test_what_flies_carries_nothing(monkeypatch):
    assert leverage(monkeypatch)[-1] == 0.0

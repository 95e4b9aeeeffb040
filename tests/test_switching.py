"""Freezing and releasing: what is given back, what causes it, and which cells it concerns.

Run as a script under mpirun, this file reports histories with switches, and what is refused.
"""

import re
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path

import dolfinx.mesh as dmesh
import numpy as np
import parallel
import pytest
import ufl
from dolfinx import fem
from histories import EPS, NEWTON, between, show
from mpi4py import MPI
from runs import prepared, regroup, step

import rigidfx as rf
from rigidfx.base.errors import SceneError
from rigidfx.decide.memory import CYCLES, HELD
from rigidfx.domain.domain import Domain

COMM = MPI.COMM_WORLD
ANY = 1e9  # 1/s; every cell qualifies
E, RHO, NU = 300.0, 1.0, 0.3
MATERIAL = rf.StVenantKirchhoff(rho=RHO, E=E, nu=NU)
SPIN = rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.3, 0.2, 0.5))
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])
DT = 0.1  # s
ROUNDING = 100 * EPS  # relative, of sums over some hundred nodes

# A vibration that is no noise of Newton's iteration, and a window that sees no whole period of it:
# right where a test is about what is done, not about what is wise.
short_windows = pytest.mark.filterwarnings("ignore:StrainRate. the window:rigidfx.RigidfxWarning")


def domain(cells=(8, 1, 1), cell="hexahedron"):
    """A bar along x with cells of 1 m; names for some of them."""
    return (
        rf.box((0, 0, 0), cells, cells, cell)
        .with_cells("left", between(0, 3))
        .with_cells("over", between(2, 4))
        .with_cells("middle", between(3, 5))
        .with_cells("right", between(5, 8))
        .with_cells("tip", between(6, 8))
    )


def bar(*effects, cells=(8, 1, 1), cell="hexahedron", **options):
    """The bar; it spins and strains unless the effects say otherwise."""
    material = options.pop("material", MATERIAL)
    return rf.Scene(domain(cells, cell), material, effects or [SPIN], **options)


def run(scene, criterion, t_end=1.0, dt=DT):
    return list(rf.simulate(scene, dt, t_end, rigidify=criterion))


def eager(tol, window, **options):
    """A criterion by which what is quiet in a window freezes, to bodies of six unknowns."""
    return rf.StrainRate(tol, window, **{"patience": 1, "wake": "none"} | options)


def events(reports):
    return [event for report in reports for event in report.events]


def times(reports, kind):
    """When something of a kind happened."""
    return pytest.approx([event.t for event in events(reports) if event.kind == kind], abs=1e-9)


class Cells:
    """Which cells of a bar are rigid, by the x of their middles."""

    def __init__(self, scene):
        mesh = scene.mesh
        owned = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
        self.x = dmesh.compute_midpoints(mesh, 3, owned)[:, 0]

    def of(self, state):
        """Cells of each body, by its name."""
        return {body.name: sorted(self.x[body.cells].tolist()) for body in state.bodies.of.records}

    def flexible(self, state):
        """Cells outside bodies."""
        return sorted(self.x[state.body_numbers() == 0].tolist())


def last_cells(scene, criterion, t_end=0.25):
    """Cells of each body, and flexible cells, in the end of a run."""
    cells = Cells(scene)
    *_, last = rf.simulate(scene, DT, t_end, rigidify=criterion)
    return cells.of(last.state), cells.flexible(last.state)


def rigid_cells(scene, criterion, t_end=0.8):
    """Cells of each body by the ends of steps; no switch loses anything."""
    found, cells = {}, Cells(scene)
    for r in rf.simulate(scene, DT, t_end, rigidify=criterion):
        found[round(r.t, 9)] = cells.of(r.state)
        for event in r.events:
            assert_balanced(event, r)
    return found


# What is given back ----------------------------------------------------------------------------


class Stress:
    """Second Piola-Kirchhoff stress, mean of each cell, shape (cells, 9) [Pa].

    It is that in the body's frame: a rigid motion does not change it.
    """

    def __init__(self, scene):
        self._u = fem.Function(scene.space)
        F = ufl.Identity(3) + ufl.grad(self._u)
        strain = (F.T * F - ufl.Identity(3)) / 2
        mu, lam = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
        S = lam * ufl.tr(strain) * ufl.Identity(3) + 2 * mu * strain
        tensors = fem.functionspace(scene.mesh, ("DG", 0, (3, 3)))
        self._form = fem.form(ufl.inner(S, ufl.TestFunction(tensors)) * ufl.dx)

    def __call__(self, state):
        state.rebuild()
        self._u.x.array[:] = state.u.x.array
        return fem.assemble_vector(self._form).array.reshape(-1, 9).copy()  # cells of 1 m³


def assert_balanced(event, scale):
    """No energy and no momentum has gone, beside measures, or a report, that tell what is large."""
    found = {
        "energy_lost": abs(event.energy_lost) / scale.energy,
        "linear": event.linear_momentum_error / scale.momentum_scale,
        "angular": event.angular_momentum_error / (8 * scale.momentum_scale),  # lever ≤ 8 m
    }
    show(**found)
    assert max(found.values()) <= ROUNDING


@pytest.mark.parametrize(
    ("mass", "turns"), [("lumped", 0.25), ("lumped", 10.0), ("consistent", 0.25)]
)
def test_freeze_turn_release(mass, turns):
    """Stresses and strain energy come back, and none where there was none; motions, too."""
    scene = bar(mass=mass)
    stress = Stress(scene)
    with prepared(scene, DT) as run:
        stepper = run.stepper
        state, n = stepper.state, 3 * scene.owned_nodes
        # The right half is stretched and vibrates at random, the left half is free of strain.
        stretch = np.where(state.X[:, 0] > 4, 0.01 * (state.X[:, 0] - 4) ** 2, 0.0)
        state.u.x.array[:n].reshape(-1, 3)[:, 0] = stretch[: n // 3]
        spin = np.cross((0.0, 0.0, 0.8), state.positions(np.arange(n // 3)) - (4.0, 0.5, 0.5))
        vibration = np.random.default_rng(1).normal(scale=0.1, size=n)
        state.v.x.array[:n] = spin.reshape(-1) + vibration
        before, S, v = stepper.measure(), stress(state), state.v.x.array[:n].reshape(-1, 3)
        v = v.copy()
        assert_balanced(regroup(run, True), before)
        frozen = stepper.measure()
        assert stepper.unknowns == 6
        assert frozen.strain == 0.0
        assert frozen.stored >= before.strain
        angle = 2 * np.pi * turns
        steps = round(angle / 0.3)
        body, motion = state.bodies[0].data, state.bodies[0].motion
        difference = v[body.nodes] - motion.velocities(body.offsets)
        dt = 2 * np.tan(angle / steps / 2) / np.linalg.norm(motion.angular_velocity)
        turned = 0.0
        for _ in range(steps):
            last = state.bodies.R[0]
            step(run, dt)
            moved = state.bodies.R[0] @ last.T
            turned += np.arccos(np.clip((np.trace(moved) - 1) / 2, -1, 1))
        motion = state.bodies[0].motion
        assert turned == pytest.approx(angle, rel=1e-3)
        assert_balanced(regroup(run, False), before)
        after, S_after = stepper.measure(), stress(state)
        v_after = state.v.x.array[:n].reshape(-1, 3)
        difference_after = v_after[body.nodes] - motion.velocities(body.offsets)
    # Positions of some 8 m have rounding errors; strains are differences over 1 m.
    noise = 8 * E * EPS
    calm = np.abs(S).max(axis=1) <= noise
    found = {
        "stress": np.abs(S_after - S).max() / noise,
        "where there was none": np.abs(S_after[calm]).max() / noise,
        "strain energy": abs(after.strain / before.strain - 1),
        "energy": abs(after.energy / before.energy - 1),
        "angular momentum": np.linalg.norm(after.angular_momentum - before.angular_momentum)
        / np.linalg.norm(before.angular_momentum),
        "linear momentum": np.linalg.norm(after.linear_momentum - before.linear_momentum)
        / before.momentum_scale,
        "velocity": np.abs(difference_after @ motion.R - difference).max() / (8 * EPS),
    }
    show(turned=turned, peak_stress=np.abs(S).max(), **found)
    assert calm.sum() == 4
    assert np.abs(S[~calm]).max(axis=1).min() > 1.0
    assert found["stress"] <= 20
    assert found["where there was none"] <= 20
    assert found["strain energy"] <= 20 * noise / np.abs(S).max()
    assert found["velocity"] <= (20 if mass == "lumped" else 200)  # solved for, if consistent
    # Each step of a body conserves to rounding.
    balance = max(found["energy"], found["angular momentum"], found["linear momentum"])
    assert balance <= ROUNDING + steps * EPS


@pytest.mark.parametrize("wake", ["all", "none"])
def test_centrifugal_strain_comes_back(wake):
    """A run that has come to rest but for its spin: frozen, turned, released as it was.

    It turns by a tenth in a step, and nothing but the spin loads it: that wakes nothing.
    """
    scene = bar(rf.InitialVelocity(angular=(0, 0, 0.5)), rf.NumericalDamping(0.5))
    stress = Stress(scene)
    criterion = rf.StrainRate(1e-5, 3.0, wake=wake, release=rf.Release(at=90.0))
    S, measured, switches = {}, {}, []
    for r in rf.simulate(scene, 0.2, 91.0, rigidify=criterion):
        switches += r.events
        if r.events:
            S[r.events[-1].kind] = stress(r.state)
            measured[r.events[-1].kind] = r
    freeze, release = switches
    assert freeze.unknowns_after == release.unknowns_before == 6
    assert release.t - freeze.t > 2 * np.pi / 0.5
    (change,) = release.changes
    back = measured["release"].strain
    difference = np.abs(S["release"] - S["freeze"]).max()
    show(freeze=freeze.t, strain_energy=back, stress=np.abs(S["freeze"]).max(),
         difference=difference / (8 * E * EPS))  # fmt: skip
    assert np.abs(S["freeze"]).max() > 0.5
    assert difference <= 20 * 8 * E * EPS
    assert back <= change.stored_before <= back * (1 + 1e-6)  # hardly any vibration is left
    assert back == pytest.approx(measured["release"].energy - measured["release"].kinetic)
    for event in switches:
        assert_balanced(event, measured["freeze"])


@MASSES
@pytest.mark.parametrize(("tol", "beside"), [(0.0, []), (1e-6, []), (1e-6, ["far half"])])
def test_rest_freezes_eager(mass, tol, beside):
    """Without motion there is nothing to divide by; nothing moves through all switches, not a bit.

    Nodes of a body that has not moved are where they were, so a step has nothing to iterate on.
    """
    far = (3.3, 20.1, 0.7)  # m; its nodes' places are rounded
    box = rf.box(far, np.add(far, (8, 1, 1)), (8, 1, 1)).with_cells("far half", between(7.3, 12))
    scene = rf.Scene(box, MATERIAL, [rf.NumericalDamping(0.1)], mass=mass)
    criterion, reports = eager(tol, DT, release=rf.Release(at=0.5), never=beside), []
    for r in rf.simulate(scene, DT, 1.0, rigidify=criterion):
        assert not r.state.u.x.array.any()
        reports.append(r)
    assert times(reports, "freeze") == [0.1, 0.6]
    assert times(reports, "release") == [0.5]
    assert [r.unknowns for r in reports[:3]] == [3 * 36, 3 * 36, 6 + 3 * 16 * len(beside)]
    assert all(r.energy == 0.0 and r.iterations == 0 for r in reports)
    assert all(np.isfinite([b.orientation for b in r.bodies]).all() for r in reports)
    assert all(event.energy_lost == 0.0 for event in events(reports))


@MASSES
def test_a_condition_may_have_its_step_solved_again(mass):
    """Fig. 2: as if the release had been planned where that step began. It is asked of its end."""
    asked = []

    def farther(report):
        if report.bodies:
            asked.append((report.step, report.t, report.strain_rate.shape, report.probes["tip"]))
        return report.t > 0.75

    ends = {}
    for release in (rf.Release(when=farther, repeat=True), rf.Release(at=0.7)):
        scene = bar(SPIN, mass=mass, probes={"tip": (8, 0.5, 0.5)})
        criterion = eager(ANY, DT, release=release, until=0.5)
        *reports, last = run(scene, criterion, 1.2)
        ends[release.repeat] = last.state.u.x.array.copy(), last.energy
        assert times([*reports, last], "release") == [0.7]
        (event,) = [e for e in events([*reports, last]) if e.kind == "release"]
        assert event.reason == ("checked: a condition" if release.repeat else "planned")
        if release.repeat:
            (step, t, shape, tip) = asked[-1]
            assert (step, t) == (8, pytest.approx(0.8))
            assert shape == last.strain_rate.shape
            # The rigid body's end of the step, and not the flexible one that has come of it.
            assert 0 < np.abs(tip - reports[8].probes["tip"]).max() < 0.02
    size = np.abs(ends[True][0]).max()
    assert np.abs(ends[True][0] - ends[False][0]).max() <= 1e-11 * size
    assert ends[True][1] == pytest.approx(ends[False][1], rel=1e-12)


@MASSES
def test_run_in_which_nothing_qualifies(mass):
    """It is the flexible one, bit by bit."""
    criterion = rf.StrainRate(1e-6, 1.0)
    alone = rf.simulate(bar(mass=mass), DT, 3.0)
    watched = rf.simulate(bar(mass=mass), DT, 3.0, rigidify=criterion)
    for a, b in zip(alone, watched, strict=True):
        assert not b.events
        for name in ("u", "v"):
            one, two = (getattr(r.state, name).x.array for r in (a, b))
            np.testing.assert_array_equal(one, two)
        assert (a.energy, a.unknowns, a.iterations) == (b.energy, b.unknowns, b.iterations)
        np.testing.assert_array_equal(a.angular_momentum, b.angular_momentum)
    assert b.strain_rate.min() > 1e-6


# What causes a release -------------------------------------------------------------------------

MIDDLE = [3.5, 4.5]


@short_windows
def test_release_at_times():
    """Steps end there, also between two steps of the grid; one time or several."""
    reports = run(bar(), eager(ANY, 0.2, release=rf.Release(at=[0.35, 0.7])))
    assert times(reports, "release") == [0.35, 0.7]
    assert times(reports, "freeze") == [0.2, 0.6, 0.9]
    assert {event.reason for event in events(reports) if event.kind == "release"} == {"planned"}
    reports = run(bar(), eager(ANY, 0.2, release=rf.Release(at=0.5), until=0.45))
    assert times(reports, "release") == [0.5]
    assert times(reports, "freeze") == [0.2]
    assert reports[-1].bodies == ()
    assert times(run(bar(), eager(ANY, 0.2, since=0.4)), "freeze") == [0.6]


@short_windows
@MASSES
@pytest.mark.parametrize(
    ("where", "left"),
    [
        ("tip", {"part 1": [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]}),
        ("middle", {"part 1": [0.5, 1.5, 2.5], "part 2": [5.5, 6.5, 7.5]}),
    ],
)
def test_release_of_a_set(where, left, mass):
    """What is left of the body stays rigid, as one body or as two, and nothing is lost."""
    scene = bar(mass=mass)
    release = rf.Release(at=0.5, where=where)
    criterion, every = eager(ANY, 0.2, release=release), [k + 0.5 for k in range(8)]
    found = rigid_cells(scene, criterion)
    (r,) = (r for r in run(scene, criterion, 0.5) if r.t == 0.5)
    (event,) = r.events
    changes = {c.name: (c.cells_before, c.cells_after) for c in event.changes}
    assert changes["part 1"] == (8, len(left["part 1"]))
    assert 0 < event.energy_released < r.energy
    assert r.stored == pytest.approx(sum(c.stored_after for c in event.changes))
    assert found[0.4] == {"part 1": every}
    assert found[0.5] == found[0.6] == left
    assert found[0.7] == {"part 1": every}  # a window later it is as before


@short_windows
def test_release_of_one_body_by_a_condition():
    """The condition sees the report; the other body moves on as it was."""
    asked = []

    def condition(report):
        asked.append(report.t)
        return ["part 2"] if report.t > 0.45 and len(report.bodies) == 2 else False

    criterion = eager(ANY, 0.2, never="middle", release=rf.Release(when=condition), until=0.55)
    scene = bar()
    cells, names, first = Cells(scene), {}, {}
    for r in rf.simulate(scene, DT, 0.8, rigidify=criterion):
        names[round(r.t, 9)] = cells.of(r.state)
        first[round(r.t, 9)] = r.state.bodies.of.records[:1]
        if r.t == 0.5:
            assert [(e.kind, e.reason) for e in r.events] == [("release", "condition")]
    left, right = [0.5, 1.5, 2.5], [5.5, 6.5, 7.5]
    assert asked == pytest.approx(np.arange(0.1, 0.85, 0.1))
    assert names[0.4] == {"part 1": left, "part 2": right}
    assert names[0.5] == names[0.8] == {"part 1": left}
    assert first[0.2] == first[0.8] != ()


@pytest.mark.filterwarnings("ignore:.* acts with a jolt")
@short_windows
@pytest.mark.parametrize(
    "effect",
    [
        rf.Traction("x1", (1.0, 0, 0), until=0.55),
        rf.Gravity((0, 0, -0.1), since=0.55),
        rf.NodalForce("x0", (0, 0.1, 0), time=rf.Table((0, 0.55, 9), (1, 1, 1.001))),
        rf.Fixed("x0", since=0.55),
        rf.PrescribedMotion(
            "x0", displacement=lambda t: (0, 0, 0), velocity=lambda t: (0, 0, 0), until=0.55
        ),
    ],
    ids=lambda effect: type(effect).__name__,
)
def test_declared_change_releases_everything(effect):
    """A jump, a kink, a support: at the end of the step that ends there, and a window anew.

    Where forces wake cells only the support does; nothing strains by more than any tolerance.
    """
    still = () if isinstance(effect, rf.PrescribedMotion) else (SPIN,)
    reports = run(bar(effect, *still), rf.StrainRate(ANY, 0.3, wake="all"), t_end=0.9)
    assert times(reports, "release") == [0.55]
    assert times(reports, "freeze") == [0.3, 0.9]  # the first step's end after 0.85
    (release,) = (event for event in events(reports) if event.kind == "release")
    assert release.reason == "a load or a support changes"
    reports = run(bar(effect, *still), eager(ANY, 0.3), t_end=0.9)
    if isinstance(effect, (rf.Fixed, rf.PrescribedMotion)):
        assert times(reports, "release") == [0.55]
        assert times(reports, "freeze") == [0.3, 0.9]
        assert {e.reason for e in events(reports)} >= {HELD}
    else:
        assert times(reports, "release") == []
        assert times(reports, "freeze") == [0.3]


def first_differences(factor, t_end, dt, window, fraction):
    """Times of freezes and releases by a load that changes smoothly, from the rules alone."""
    freezes, releases, frozen_at, begin, largest = [], [], None, 0.0, abs(factor(0.0))
    for k in range(round(t_end / dt)):
        t = k * dt
        moved = 0.0 if frozen_at is None else abs(factor(t + dt / 2) - factor(frozen_at))
        if np.isfinite(fraction) and moved > fraction * largest:
            releases.append(t)
            frozen_at, begin = None, t
        largest = max(largest, abs(factor(t + dt)))
        if t + dt >= begin + window - 1e-9:
            if frozen_at is None:
                freezes.append(t + dt)
                frozen_at = t + dt
            begin = t + dt
    return freezes, releases


@short_windows
@pytest.mark.parametrize(
    "factor",
    [lambda t: 1 + 0.97 * t, lambda t: np.sin(2 * t), lambda t: np.exp(-2 * t)],
    ids=["growing", "swinging", "fading"],
)
@pytest.mark.parametrize("fraction", [0.1, 0.25, np.inf])
def test_smooth_load_releases_when_it_has_changed_enough(factor, fraction):
    """Seen before the step, so that this is computed with the flexible cells already."""
    scene = bar(SPIN, rf.Gravity((0, 0, -0.1), time=factor))
    criterion = eager(ANY, 0.2, load_change=fraction, wake="all")  # of the paper's rule
    reports = run(scene, criterion, t_end=2.0)
    freezes, releases = first_differences(factor, 2.0, DT, 0.2, fraction)
    print(releases)
    assert times(reports, "freeze") == freezes
    assert times(reports, "release") == releases
    assert (len(releases) == 0) == np.isinf(fraction)
    for r in reports:
        for event in r.events:
            if event.kind == "release":
                assert event.t == pytest.approx(r.t - r.dt)
                assert event.reason == "Gravity on 'all cells' changes"
                assert r.unknowns == 3 * 36
                assert r.bodies == () or event is not r.events[-1]


@short_windows
def test_damping_and_time_steps_release_nothing():
    """Nor do windows in which cells qualify that are rigid already."""
    scene = bar(SPIN, rf.NumericalDamping(0.2, since=0.35, until=0.75))
    reports = run(scene, eager(ANY, 0.2))
    assert sorted({round(r.dt, 9) for r in reports}) == [0.0, 0.05, 0.1]
    assert [(event.kind, event.t) for event in events(reports)] == [("freeze", 0.2)]


# Which cells -----------------------------------------------------------------------------------

LEFT, RIGHT = [0.5, 1.5, 2.5], [5.5, 6.5, 7.5]


@short_windows
@pytest.mark.parametrize(
    "criterion",
    [
        eager(ANY, 0.2, never="middle"),
        eager(ANY, 0.2, never=["middle"]),
        eager(ANY, 0.2, tolerances={"middle": 0.0}),
        eager(0.0, 0.2, tolerances={"left": ANY, "right": ANY}),
    ],
)
def test_cells_named_by_the_criterion(criterion):
    """Never rigid, or with a tolerance of their own."""
    bodies, flexible = last_cells(bar(), criterion)
    assert bodies == {"part 1": LEFT, "part 2": RIGHT}
    assert flexible == MIDDLE


@short_windows
def test_least_tolerance_counts_where_sets_overlap():
    for order in (("left", "over"), ("over", "left")):
        tolerances = {name: ANY if name == "left" else 0.0 for name in order}
        bodies, flexible = last_cells(bar(), eager(0.0, 0.2, tolerances=tolerances))
        assert bodies == {"part 1": LEFT[:2]}
        assert flexible == [2.5, *MIDDLE, *RIGHT]


@short_windows
def test_least_size_of_a_body():
    for least, wanted in ((2, {"part 1": [6.5, 7.5]}), (3, {})):
        criterion = eager(0.0, 0.2, tolerances={"tip": ANY}, min_cells=least)
        assert last_cells(bar(), criterion)[0] == wanted


@short_windows
@MASSES
def test_cells_that_are_rigid_always(mass):
    """They grow together with what is found, and stay rigid when the rest is released."""
    every = [*LEFT, *MIDDLE, *RIGHT]
    scene = bar(SPIN, rf.Rigid("left"), rf.Rigid("right"), mass=mass)
    found = rigid_cells(scene, eager(ANY, 0.2, release=rf.Release(at=[0.5]), until=0.6))
    assert found[0.1] == {"left": LEFT, "right": RIGHT}
    assert found[0.2] == found[0.4] == {"left": every}
    assert found[0.5] == found[0.8] == {"left": LEFT, "right": RIGHT}


@MASSES
@pytest.mark.parametrize("moves", [False, True], ids=["held", "moved"])
def test_table_accounts_for_all_momentum(tmp_path, mass, moves):
    """L and J grow by what reactions and impulses give, also where cells beside a support freeze.

    With a consistent mass the support has its share in a freeze; with a lumped one it has not.
    """
    block = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_cells("b", lambda x: x[0] >= 0.99)
    path = (lambda t: (0.0, 0.0, t)) if moves else (lambda t: (0.0, 0.0, 0.0))
    effects = [
        rf.PrescribedMotion("x0", displacement=path, until=1.2),
        rf.PrescribedMotion("x0", displacement=lambda t: (0.0, t, 0.0), since=1.2),
    ]
    push = rf.Traction("x1", (0.0, 4.0, 1.0), until=0.1)
    scene = rf.Scene(
        block, rf.StVenantKirchhoff(E=1e3, nu=0.3, rho=100.0), [*effects, push], mass=mass
    )
    release = rf.Release(at=(0.35, 0.65))
    criterion = eager(0.0, 0.1, tolerances={"b": ANY}, release=release)
    with warnings.catch_warnings(), rf.Recorder(scene, tmp_path) as recorder:
        warnings.simplefilter("ignore", rf.RigidfxWarning)  # the window is short
        reports = []
        for r in rf.simulate(scene, 0.05, 1.5, rigidify=criterion):
            recorder.write(r)
            reports.append(r)
    h = rf.read_history(recorder.history)

    def vector(name):
        return np.stack([h[f"{name}_{axis}"] for axis in "xyz"], axis=1)

    # From 0.1 s on nothing but the support acts.
    late = h["t"] > 0.1 + 1e-9
    turned = np.array([r.reaction_moments.get("x0", np.zeros(3)) for r in reports])
    for name, given, at_once, lever in (
        ("L", vector("reaction_x0"), "impulse", 1.0),
        ("J", turned, "angular_impulse", 5.0),
    ):
        gained = np.diff(vector(name), axis=0, prepend=np.zeros((1, 3)))
        gap = (gained - h["dt"][:, None] * given - vector(at_once))[late]
        size = h["momentum_scale"].max() * lever
        show(**{name: np.abs(gap).max() / size})
        assert np.abs(gap).max() <= NEWTON * size
    given = h["work_of_loads"] + h["work_of_supports"] + h["impact_energy"]
    assert np.abs(np.diff(h["energy"]) - given[1:]).max() <= 1e-11 * h["energy"].max()
    switches = events(reports)
    assert len(switches) >= 4
    for event in switches:
        assert_balanced(event, reports[-1])
    given = max(np.abs(e.impulse).max() for e in switches)
    assert given == 0.0 if mass == "lumped" else given > 1e-3 * reports[-1].momentum_scale


@short_windows
def test_set_in_two_pieces_that_is_rigid_always():
    """It is one body, also when what was found between the pieces is released."""
    ends = domain().with_cells("ends", lambda x: np.abs(x[0] - 4) >= 2 - 1e-9)
    scene = rf.Scene(ends, MATERIAL, [SPIN, rf.Rigid("ends", each=False)])
    release = rf.Release(at=0.5, where="middle")
    found = rigid_cells(scene, eager(ANY, 0.2, release=release, until=0.6))
    assert found[0.1] == {"ends": [0.5, 1.5, 6.5, 7.5]}
    assert found[0.5] == found[0.8] == {"ends": [*LEFT, *RIGHT]}
    assert found[0.2] == found[0.4] == {"ends": [*LEFT, *MIDDLE, *RIGHT]}


@short_windows
@pytest.mark.parametrize(
    "effects",
    [
        (rf.Rigid("left", mass=5.0),),
        (rf.Rigid("left", inertia=[[5, 0, 0], [0, 6, 0], [0, 0, 7]]),),
        (rf.Rigid("left"), rf.Resultant("left", torque=(0, 0, 0.1))),
    ],
    ids=["mass", "inertia", "resultant"],
)
@MASSES
def test_body_with_data_of_its_own(effects, mass):
    """It neither grows nor merges nor goes; no other body shares its nodes, and nothing is lost."""
    criterion = eager(ANY, 0.2, release=rf.Release(at=0.5), until=0.6)
    found = rigid_cells(bar(SPIN, *effects, mass=mass), criterion)
    assert found[0.1] == found[0.5] == found[0.8] == {"left": LEFT}
    assert found[0.2] == found[0.4] == {"left": LEFT, "part 2": [4.5, *RIGHT]}


@short_windows
@pytest.mark.parametrize("components", ["xyz", "y"])
def test_cells_at_supports_stay_flexible(components):
    """Those that touch a node of which any component is held, while it is held."""
    fall = rf.Gravity((0, 0, -1.0))
    support = rf.Fixed("x0", components, until=0.5)
    scene = bar(fall, support, cells=(8, 2, 2))
    found, cells = {}, Cells(scene)
    for r in rf.simulate(scene, DT, 0.8, rigidify=eager(ANY, 0.2)):
        found[round(r.t, 9)] = cells.flexible(r.state)
    assert found[0.2] == found[0.4] == [0.5] * 4
    assert len(found[0.5]) == len(found[0.6]) == 32
    assert found[0.7] == []


@short_windows
@pytest.mark.parametrize("measure", ["rms", "paper"])
def test_measures_of_the_strain_rate(measure):
    """Of a homogeneous stretch: |Ė|, or |Ė|/V^½ as in the paper, whatever the mesh."""
    rate, size = 1e-3, 0.5
    scene = rf.Scene(
        rf.box((0, 0, 0), (2, 1, 1), (4, 2, 2)),
        MATERIAL,
        [rf.InitialVelocity(function=lambda x: np.stack([rate * x[0], 0 * x[0], 0 * x[0]]))],
    )
    dt = 1e-4  # the stress that the stretch brings about acts a step later
    reports = rf.simulate(scene, dt, dt, rigidify=rf.StrainRate(1.0, 1.0, measure=measure))
    *_, last = reports
    wanted = rate if measure == "rms" else rate / size**1.5
    # E = ε + ε²/2 with ε = rate dt, and the change of the velocity (c dt/h)² in relative terms
    assert last.strain_rate == pytest.approx(wanted, rel=(np.sqrt(E / RHO) * dt / size) ** 2 * 4)


# Windows and warnings --------------------------------------------------------------------------


def swinging(*effects):
    """A bar without lateral strain that vibrates along its axis, in its lowest mode."""
    velocity = rf.InitialVelocity(
        function=lambda x: np.stack([0.1 * np.cos(np.pi * x[0] / 8), 0 * x[0], 0 * x[0]])
    )
    return bar(velocity, *effects, material=rf.StVenantKirchhoff(rho=RHO, E=E, nu=0.0))


# Of eight linear elements with lumped mass: ω = 2 c/h sin(π h/2 L).
PERIOD = np.pi / (np.sqrt(E / RHO) * np.sin(np.pi / 16))


def test_window_that_is_shorter_than_the_period():
    t_end, short = 20 * PERIOD, rf.StrainRate(0.0, 0.6 * PERIOD, wake="all")
    with pytest.warns(rf.RigidfxWarning, match="shorter than the longest period") as caught:
        run(swinging(), short, t_end=t_end, dt=PERIOD / 20)
    (warning,) = (w for w in caught if "StrainRate" in str(w.message))  # once
    message = str(warning.message)
    assert Path(warning.filename).parent == Path(__file__).parent
    (seen,) = re.findall(r"period seen, (\S+) s", message)
    # at the first window's end at which CYCLES cycles have been seen
    assert float(seen) == pytest.approx(PERIOD, rel=1 / (4 * CYCLES))
    for rule in (rf.StrainRate(0.0, 1.2 * PERIOD, wake="all"), replace(short, wake="local")):
        run(swinging(), rule, t_end=t_end, dt=PERIOD / 20)  # no warning


def test_window_auto():
    """It waits until it has seen some periods of the motion, and of the loads."""
    dt = PERIOD / 20
    (freeze,) = events(run(swinging(), eager(ANY, "auto"), 6 * PERIOD, dt))
    assert CYCLES * PERIOD * 0.95 <= freeze.t <= (CYCLES + 1) * PERIOD
    slow = 2.5 * PERIOD
    load = rf.Gravity((0, 0, -0.1), time=lambda t: np.sin(2 * np.pi * t / slow))
    (freeze,) = events(run(swinging(load), eager(ANY, "auto"), 6 * slow, dt))
    assert CYCLES * slow * 0.95 <= freeze.t <= (CYCLES + 1) * slow


@pytest.mark.parametrize("wake", ["all", "none"])
def test_window_auto_forgets_a_load_that_has_come_to_stay(wake):
    """In a record it might be the beginning of a slow oscillation, and nothing would freeze."""
    load = rf.Gravity((0, 0, -0.1), time=lambda t: min(t / PERIOD, 1.0))
    criterion = rf.StrainRate(ANY, "auto", wake=wake)
    (freeze,) = events(run(swinging(load), criterion, 8 * PERIOD, PERIOD / 20))
    assert (1 + CYCLES) * PERIOD * 0.95 <= freeze.t <= (2 + CYCLES) * PERIOD


def test_window_auto_at_rest():
    """Nothing oscillates: as soon as that can be told."""
    (freeze,) = events(run(bar(rf.NumericalDamping(0.1)), rf.StrainRate(0.0, "auto"), t_end=2.0))
    assert freeze.t <= 1.0


# Bad input -------------------------------------------------------------------------------------


def _without_ghosts():
    mesh = dmesh.create_box(
        COMM, [(0, 0, 0), (8, 2, 2)], (8, 2, 2), dmesh.CellType.hexahedron,
        ghost_mode=dmesh.GhostMode.none,
    )  # fmt: skip
    return run(rf.Scene(Domain(mesh), MATERIAL, [SPIN]), rf.StrainRate(1.0, 0.1), t_end=0.1)


# Several ranks ---------------------------------------------------------------------------------


def _story(**options):
    """Kicked and damped: freezes, grows, merges; a set is released, and all by a load."""
    scene = rf.Scene(
        domain((12, 2, 2)).with_cells("far", between(9, 12)),
        rf.StVenantKirchhoff(rho=1.0, E=1e3, nu=0.3),
        [
            rf.Traction("x1", (0.0, 6.0, 4.0), until=1.0),
            rf.Traction("x0", (3.0, -2.0, 4.0), until=1.0),
            rf.NumericalDamping(0.5),
            rf.Gravity((0, 0, -1.0), since=11.6),
        ],
        probes={"on the body": (1.2, 0.3, 0.6), "at the end": (11.6, 0.6, 0.3)},
    )
    release = rf.Release(at=10.6, where="far")
    return scene, rf.StrainRate(8e-3, 1.0, release=release, **options), 0.2, 12.4


def _one_end():
    """The only body lies on one rank; a smooth load releases it, and a condition."""
    scene = bar(
        SPIN,
        rf.Gravity((0, 0, -1.0), time=lambda t: 1 + 0.3 * t),
        cells=(8, 2, 2),
        probes={"at the end": (7.6, 0.6, 0.3)},
    )
    release = rf.Release(when=lambda r: "part 2" if r.bodies and 1.15 < r.t < 1.25 else False)
    return (
        scene,
        rf.StrainRate(0.0, 0.2, tolerances={"left": ANY}, wake="all", release=release),
        0.1,
        2.0,
    )


def _pushed():
    """A body that has kept nothing grows and is released, with a consistent mass."""
    push = rf.Traction("x1", (0.0, 4.0, 1.0), until=0.3)
    probes = {"at the end": (7.6, 0.6, 0.3)}
    scene = bar(rf.Rigid("left"), push, mass="consistent", probes=probes)
    return scene, eager(ANY, 0.5, release=rf.Release(at=1.2)), 0.1, 2.0


STORIES = {
    "story": partial(_story, wake="all"),
    "one end": _one_end,
    "pushed": _pushed,
}


def _history(scene, criterion, dt, t_end):
    """Steps, switches and bodies by the numbers of their cells in the mesh file."""
    topology, rows = scene.mesh.topology, []
    for r in rf.simulate(scene, dt, t_end, rigidify=criterion):
        r.state.rebuild()
        cells = [topology.original_cell_index[b.cells] for b in r.state.bodies.of.records]
        every = zip(*scene.comm.allgather(cells), strict=True)
        n = 3 * scene.owned_nodes
        rows.append(
            {
                "t": r.t,
                "unknowns": r.unknowns,
                "bodies": [[b.name, b.number] for b in r.bodies],
                "cells": [np.sort(np.concatenate(parts)).tolist() for parts in every],
                "events": [
                    [e.t, e.kind, e.reason, e.unknowns_before, e.unknowns_after]
                    + [[c.name, c.number, c.cells_before, c.cells_after] for c in e.changes]
                    for e in r.events
                ],
                "energy": [r.kinetic, r.strain, r.stored],
                "momentum": [*r.linear_momentum, *r.angular_momentum],
                "displacement": [float(x) for p in r.probes.values() for x in p],
                "norms": [
                    float(np.sqrt(scene.sum(f.x.array[:n] @ f.x.array[:n])))
                    for f in (r.state.u, r.state.v)
                ],
                "released": [e.energy_frozen + e.energy_released for e in r.events],
                "closeness": r.closeness,
                "balance": [
                    max(
                        abs(e.energy_lost) / r.energy,
                        e.linear_momentum_error / r.momentum_scale,
                        e.angular_momentum_error / (12 * r.momentum_scale),
                    )
                    for e in r.events
                ],
            }
        )
    return rows


@pytest.fixture(scope="module")
def on_ranks():
    """What this file as a script reports, by the number of ranks."""
    return {n: parallel.run(__file__, n, timeout=600) for n in (1, 3)}


@pytest.mark.parallel
@pytest.mark.parametrize("name", STORIES)
def test_history_is_that_on_one_rank(on_ranks, name):
    """Switches and bodies are the same, numbers to 1e-9 of their largest: the issue's bound."""
    one, several = on_ranks[1][name], on_ranks[3][name]
    for key in ("t", "unknowns", "bodies", "cells", "events"):
        assert [row[key] for row in several] == [row[key] for row in one], key
    for key in ("energy", "momentum", "displacement", "norms", "released"):
        a, b = (np.concatenate([row[key] for row in rows]) for rows in (one, several))
        scale = np.abs(a).max(initial=0.0)
        worst = np.abs(a - b).max(initial=0.0)
        print(f"{key}: {worst / scale if scale else 0.0:.2g}")
        assert worst <= 1e-9 * scale, key


@pytest.mark.parallel
def test_story_has_all_kinds_of_switches(on_ranks):
    """New bodies, growth, a merger, loss of some cells, release of all; no decision is a tie."""
    rows = on_ranks[1]["story"]
    kinds = set()
    lost = max(of for name in STORIES for row in on_ranks[1][name] for of in row["balance"])
    for row in rows:
        for _, kind, _, _, _, *changes in row["events"]:
            shape = [(before > 0, after > 0, after > before) for _, _, before, after in changes]
            if kind == "release":
                kinds |= {"less" if after else "gone" for _, after, _ in shape}
            else:
                kinds |= {"more" if before else "new" for before, after, _ in shape if after}
                kinds |= {"merged" for _, after, _ in shape if not after}
    closeness = np.nanmin([row["closeness"] for row in rows])
    show(closeness=closeness, balance=lost)
    assert kinds == {"less", "gone", "more", "new", "merged"}
    assert lost <= ROUNDING
    assert closeness > 1e-4  # far more than histories differ
    assert min(row["unknowns"] for row in rows) == 6
    reasons = [event[2] for row in on_ranks[1]["one end"] for event in row["events"]]
    assert {"condition", "Gravity on 'all cells' changes"} < set(reasons)


@pytest.mark.parallel
def test_a_mesh_without_ghosts_is_refused_on_three_ranks(on_ranks):
    """The same message on all, and no rank waits for another."""
    first, *others = on_ranks[3]["refused"]
    assert others == [first] * 2
    assert "distributed without ghost cells" in first


@pytest.mark.parallel
def test_warnings_are_shown_on_rank_0(on_ranks):
    zero, *others = on_ranks[3]["warned"]
    zero = [text for text in zero if not text.startswith("Scene:")]  # its cells lock, too
    assert len(zero) == 1
    assert "below what the end of Newton's" in zero[0]
    assert others == [[], []]


def _refusal():
    with pytest.raises(SceneError) as found:
        _without_ghosts()
    return str(found.value)


def _script():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rf.RigidfxWarning)  # of short windows
        results = {name: _history(*make()) for name, make in STORIES.items()}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", rf.RigidfxWarning)
        run(bar(), rf.StrainRate(1e-16, 0.5), t_end=0.5)
        mine = [str(w.message) for w in caught if w.category is rf.RigidfxWarning]
    results["warned"] = COMM.gather(mine)
    if COMM.size > 1:
        results["refused"] = COMM.gather(_refusal())
    parallel.report(results)


if __name__ == "__main__":
    _script()

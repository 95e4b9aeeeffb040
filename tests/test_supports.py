"""Supports: what they hold, when, and the books when they begin on a moving body."""

import numpy as np
import pytest
from histories import EPS, NEWTON, column, drift
from hypothesis import given, settings
from hypothesis import strategies as st

import rigidfx as rf
from rigidfx.base.errors import SceneError
from rigidfx.base.instants import resolution

# Supports that begin on moving bodies: their impacts are the subject.
pytestmark = pytest.mark.filterwarnings("ignore:.* acts with a jolt")

MATERIAL = rf.NeoHooke(rho=2.0, E=50.0, nu=0.3)
MOVING = rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.1, 0.2, 0.3))
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])


def _bar(*effects, cells=(4, 1, 1), **options):
    domain = rf.box((0, 0, 0), (4, 1, 1), cells)
    domain = domain.with_vertices("corner", lambda x: np.isclose(x.sum(axis=0), 0.0))
    return rf.Scene(domain, MATERIAL, effects, **options)


class Books:
    """Checks the balances of energy and linear momentum of every step of a run."""

    def __init__(self):
        self.impacts, self._before = [], None

    def enter(self, r, loads=(0.0, 0.0, 0.0)):
        """One more report; `loads` is the sum of load forces in its step."""
        before, self._before = self._before, r
        if before is None:
            return
        energy, impulse = 0.0, r.impulse
        if r.impact is not None:
            self.impacts.append(r.impact)
            energy = r.impact.energy
        force = np.asarray(loads) + sum(r.reactions.values(), np.zeros(3))
        # Newton leaves 1e-12 of the forces, which rounding over the nodes may add to.
        scale = r.energy + before.energy + abs(r.work_of_supports) + abs(energy)
        dH = r.energy - before.energy
        assert abs(dH - r.work_of_loads - r.work_of_supports - energy) <= 20 * NEWTON * scale
        scale = r.momentum_scale + before.momentum_scale + r.dt * np.abs(force).sum()
        dL = r.linear_momentum - before.linear_momentum
        assert np.abs(dL - r.dt * force - impulse).max() <= 20 * NEWTON * scale


@MASSES
def test_support_that_begins_on_a_moving_body(mass):
    """An impact: held nodes stop exactly and stay, nothing rings, energy and impulse are booked."""
    scene = _bar(rf.Fixed("x0", since=0.5), MOVING, mass=mass)
    held, books = scene.nodes("x0", "test"), Books()
    at_rest = None
    for r in rf.simulate(scene, 0.1, 2.0):
        books.enter(r)
        v, u = (f.x.array.reshape(-1, 3)[held] for f in (r.state.v, r.state.u))
        if r.t <= 0.5 + EPS:
            assert np.abs(v).min(axis=0).max() > 0.01
            assert r.reactions == {}
            at_rest = u.copy()
            continue
        assert np.all(v == 0.0)
        assert np.all(u == at_rest)
        assert set(r.reactions) == {"x0"}
    (impact,) = books.impacts
    assert impact.t == pytest.approx(0.5, abs=EPS)
    assert impact.supports == ("x0",)
    assert impact.energy < 0


@MASSES
def test_impact_on_one_point_keeps_the_moment_about_it(mass):
    """A hinge at one node passes on no moment: ΔJ about the origin is x × its impulse."""
    scene = _bar(rf.Fixed("corner", since=0.3), MOVING, mass=mass)
    (node,) = scene.nodes("corner", "test", (0,))
    before, place = None, None
    for r in rf.simulate(scene, 0.1, 2.0):
        if before is not None and "corner" in r.reactions:
            dJ = r.dt * np.cross(place, r.reactions["corner"])
            if r.impact is not None:
                dJ = dJ + r.impact.angular_impulse
                moment = np.cross(place, r.impact.impulse)
                assert np.abs(moment - r.impact.angular_impulse).max() <= 1e-12
            error = np.abs(r.angular_momentum - before.angular_momentum - dJ).max()
            assert error <= 100 * NEWTON * r.momentum_scale
        place = r.state.u.x.array.reshape(-1, 3)[node].copy()
        before = r


@MASSES
def test_support_by_component_in_a_window(mass):
    """Only the named components are held, and only in the window; then L is kept again."""
    scene = _bar(rf.Fixed("x0", "xz", since=0.35, until=1.0), MOVING, mass=mass)
    held, books = scene.nodes("x0", "test"), Books()
    free_momentum = None
    for r in rf.simulate(scene, 0.1, 1.5):
        books.enter(r)
        v = r.state.v.x.array.reshape(-1, 3)[held]
        if 0.35 < r.t <= 1.0 + EPS:
            assert np.all(v[:, [0, 2]] == 0.0)
            assert np.abs(v[:, 1]).min() > 0.0
            assert r.reactions["x0"][1] == 0.0
        elif r.t > 1.0 + EPS:
            assert r.reactions == {}
            if free_momentum is not None:
                change = np.abs(r.linear_momentum - free_momentum).max()
                assert change <= 10 * NEWTON * r.momentum_scale
            free_momentum = r.linear_momentum
    assert len(books.impacts) == 1


def test_supported_body_keeps_its_energy():
    """Reactions of supports at rest do no work: a cantilever swings on for 40 s."""
    kick = rf.InitialVelocity(function=lambda X: 0.3 * np.outer([0, 1, 0.5], X[0].round(9)))
    reports = list(rf.simulate(_bar(rf.Fixed("x0"), kick), 0.2, 40.0))
    assert drift(column(reports, "energy")) <= 1e-10
    assert np.all(column(reports, "work_of_supports") == 0.0)
    assert reports[1].impact is None


class Ramp:
    """Constant velocity v from t0 on."""

    def __init__(self, t0, v):
        self.breakpoints, self._v = (t0,), np.asarray(v)

    def __call__(self, t):
        return tuple(self._v * max(0.0, t - self.breakpoints[0]))


@MASSES
def test_prescribed_motion_that_jumps_in_velocity(mass):
    """The nodes take the path's velocity at once, follow it, and the books balance."""
    velocity = np.array([0.2, 0.0, -0.1])
    scene = _bar(rf.PrescribedMotion("x1", displacement=Ramp(0.55, velocity)), mass=mass)
    held, books = scene.nodes("x1", "test"), Books()
    for r in rf.simulate(scene, 0.1, 2.0):
        books.enter(r)
        v, u = (f.x.array.reshape(-1, 3)[held] for f in (r.state.v, r.state.u))
        moving = r.t > 0.55 + EPS
        # The difference quotient of the path knows the velocity to eps·t/(1e-3 Δt).
        assert np.abs(v - moving * velocity).max() <= 20 * EPS * 2 / 1e-4
        assert np.abs(u - max(0.0, r.t - 0.55) * velocity).max() <= 10 * EPS
    (impact,) = books.impacts
    assert impact.t == pytest.approx(0.55, abs=EPS)
    assert impact.energy > 0


@MASSES
@settings(max_examples=8)
@given(
    size=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    frequency=st.floats(0.2, 5.0),
    begin=st.floats(0.0, 0.7),
    length=st.floats(0.05, 0.8),
    dt=st.floats(0.05, 0.2),
)
def test_books_of_any_prescribed_motion(mass, size, frequency, begin, length, dt):
    """Whatever moves the end of a flying bar, and when: energy and momentum are accounted for."""

    def path(t):
        return tuple(s * np.sin(frequency * t) for s in size)

    def velocity(t):
        return tuple(frequency * s * np.cos(frequency * t) for s in size)

    motion = rf.PrescribedMotion(
        "x1", "xy", displacement=path, velocity=velocity, since=begin, until=begin + length
    )
    start = () if begin <= resolution(0.0, dt) else (MOVING,)  # or it contradicts the path
    gravity = np.array([0.0, -1.0, 0.5])
    scene = _bar(motion, rf.Gravity(tuple(gravity)), *start, mass=mass, cells=(2, 1, 1))
    held, books, place = scene.nodes("x1", "test"), Books(), None
    for r in rf.simulate(scene, dt, 1.7):
        books.enter(r, 8.0 * gravity)
        u = r.state.u.x.array.reshape(-1, 3)[held].copy()
        if "x1" in r.reactions:
            moved = np.subtract(path(r.t), path(r.t - r.dt))
            assert np.abs((u - place)[:, :2] - moved[:2]).max() <= 100 * EPS
        place = u


@MASSES
def test_impact_at_the_start(mass):
    """A body at rest whose end moves from t = 0 on: the initial report has the impact."""
    motion = rf.PrescribedMotion("x1", displacement=Ramp(0.0, (0.2, 0.0, 0.0)))
    reports, books = rf.simulate(_bar(motion, mass=mass), 0.1, 0.5), Books()
    first = next(reports)
    assert first.impact.energy == pytest.approx(first.kinetic, rel=100 * EPS)
    assert first.impact.impulse == pytest.approx(first.linear_momentum, abs=1e3 * EPS)
    books.enter(first)
    for r in reports:
        books.enter(r)
    assert books.impacts == []


def test_supports_may_share_nodes_where_they_agree():
    """Equal motions, other components or other windows are no conflict."""
    for pair in (
        (rf.Fixed("x0"), rf.Fixed("y0", "xy")),
        (rf.Fixed("x0", "x"), rf.PrescribedMotion("y0", "yz", displacement=Ramp(0, (0, 1, 0)))),
        (
            rf.Fixed("x0", until=0.2),
            rf.PrescribedMotion("x0", displacement=Ramp(0.2, (1, 0, 0)), since=0.2),
        ),
    ):
        scene = _bar(*pair)
        books = Books()
        for r in rf.simulate(scene, 0.1, 0.5):
            books.enter(r)


def test_shared_nodes_are_counted_once():
    """Reactions of two supports at common nodes add up to the weight; the first has theirs."""
    g = np.array([0.0, 0.0, -1.0])
    loads = [rf.Gravity(tuple(g))]
    scene = _bar(rf.Fixed("x0"), rf.Fixed("z0"), *loads, rf.Preload(loads))
    reports = list(rf.simulate(scene, 0.1, 0.3))
    total = sum(reports[-1].reactions.values(), np.zeros(3))
    assert np.abs(total + 8.0 * g).max() <= 100 * NEWTON * 8.0
    other = _bar(rf.Fixed("z0"), rf.Fixed("x0"), *loads, rf.Preload(loads))
    *_, last = rf.simulate(other, 0.1, 0.3)
    assert reports[-1].reactions["x0"][2] > last.reactions["x0"][2] + 0.1


# Static preload ---------------------------------------------------------------------------------


@pytest.mark.parametrize("increments", [1, 4])
def test_preloaded_body_stays_where_it_sags(increments):
    """Gravity in statics and on in the dynamics: nothing moves, the reaction is the weight."""
    gravity = rf.Gravity((0.0, 0.0, -0.1))
    scene = _bar(
        rf.Fixed("x0"), gravity, rf.Preload([gravity], increments), probes={"p": (4, 1, 1)}
    )
    reports = list(rf.simulate(scene, 0.2, 10.0))
    sag = reports[0].probes["p"]
    assert sag[2] < -0.05
    for r in reports[1:]:
        # What statics leave (1e-12 of the load, times a flexibility of some 1/load) swings.
        assert np.abs(r.probes["p"] - sag).max() <= 100 * NEWTON
        assert r.kinetic <= (100 * NEWTON) ** 2 * 8.0
        assert np.abs(r.reactions["x0"] - [0, 0, 0.8]).max() <= 1e3 * NEWTON * 0.8


def test_preload_let_go_oscillates():
    """Without the load in the dynamics the energy of statics is released and kept."""
    load = rf.NodalForce("x1", (0.0, 0.05, 0.0))
    scene = _bar(rf.Fixed("x0"), rf.Preload([load]), probes={"p": (4, 1, 1)})
    reports = list(rf.simulate(scene, 0.5, 100.0))
    swing = np.array([r.probes["p"][1] for r in reports])
    assert reports[0].kinetic == 0.0
    assert swing.min() < -0.9 * swing[0] < 0
    assert drift(column(reports, "energy")) <= 1e-10


@pytest.mark.filterwarnings("ignore:.*as a door about its hinge")
def test_preload_of_parts_that_are_held_one_by_one():
    """Two loose cubes, and two on a hinge: a spring at the second suffices, or a support."""
    cube = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)], dtype=float)
    grid = np.array([[i, j, k] for k in (0, 1) for j in (0, 1, 2) for i in (0, 1, 2)], dtype=float)
    hinged = np.array([[0, 1, 3, 4, 9, 10, 12, 13], [4, 5, 7, 8, 13, 14, 16, 17]])
    two = np.concatenate([cube, cube + np.array([3.0, 0, 0])]), np.arange(16).reshape(2, 8)
    for points, cells in (two, (grid, hinged)):
        far = points[:, 0].max()
        domain = rf.from_arrays(points, cells).with_facets("a", lambda x: np.abs(x[0]) < 1e-9)
        domain = domain.with_facets("b", lambda x, far=far: np.abs(x[0] - far) < 1e-9)
        for more in (rf.Fixed("b"), rf.Spring("b", 3.0)):
            effects = [rf.Fixed("a"), more, rf.Preload([rf.Gravity((0, 0, -0.1))])]
            scene = rf.Scene(
                domain, MATERIAL, effects, probes={"p": (far - 0.5, *points[-1, 1:] - 0.5)}
            )
            steps = rf.simulate(scene, 0.1, 0.1)
            assert -0.5 < next(steps).probes["p"][2] < 0
            steps.close()


def test_initial_velocity_that_contradicts_a_support():
    """Refused, unless the support's nodes are given the support's velocity."""
    path = Ramp(-1.0, (1.0, 0, 0))
    moves = rf.PrescribedMotion("x0", displacement=path, velocity=lambda t: (1.0, 0, 0))
    next(
        rf.simulate(  # a velocity known by the path only is the same, but for rounding
            _bar(
                rf.PrescribedMotion("x0", displacement=path), rf.InitialVelocity(linear=(1, 0, 0))
            ),
            0.1,
            1.0,
        )
    )
    for support, start in (
        (rf.Fixed("x0"), MOVING),
        (rf.Fixed("x0", "y"), rf.InitialVelocity(linear=(0, 1.0, 0))),
        (moves, rf.InitialVelocity(linear=(0.9, 0, 0))),
        (rf.Fixed("x0", since=1e-12), MOVING),  # which is the start, but for rounding
    ):
        with pytest.raises(SceneError, match="contradicts"):
            next(rf.simulate(_bar(support, start), 0.1, 1.0))
    for support, start in (
        (rf.Fixed("x0", "y"), rf.InitialVelocity(linear=(1.0, 0, 0))),
        (moves, rf.InitialVelocity(linear=(1.0, 0, 0))),
        (rf.Fixed("x0", since=0.5), MOVING),
    ):
        assert [r.impact for r in rf.simulate(_bar(support, start), 0.1, 0.2)] == [None] * 3

"""Steps as long as an error lets them be."""

from itertools import pairwise

import numpy as np
import parallel
import pytest
from histories import heard, tips
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import rigidfx as rf
from rigidfx.plot.pictures import spent
from rigidfx.scene.damped import Damped, comes_back

# Paths whose velocity jumps.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.* acts with a jolt"),
    pytest.mark.filterwarnings("ignore:Contact .* as nodes of the surface ring"),
]

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
T = 8.0


def bar(*effects, cells=(4, 1, 1)):
    box = rf.box((0, 0, 0), (8, 1, 1), cells)
    return rf.Scene(box, SOFT, effects, probes={"tip": (8, 0.5, 0.5)})


def pushed():
    """A clamped bar, pushed for two seconds: it swings from then on."""
    push = rf.Traction("x1", (0, 0, 200.0), time=lambda t: np.sin(np.pi * t / 2), until=2.0)
    return bar(rf.Fixed("x0"), push)


def tumbling():
    return bar(rf.InitialVelocity(angular=(0.3, 1.0, 0.5)))


def shaken():
    path = rf.PrescribedMotion(
        "x0", displacement=lambda t: (0, 0, 0.05 * np.sin(2 * np.pi * t / 3) * min(1.0, t / 3))
    )
    return bar(path)


def run(scene, dt, t_end=T, **more):
    return list(rf.simulate(scene, dt, t_end, progress=False, **more))


def times(reports):
    return np.array([r.t for r in reports])


# The estimate and the rule --------------------------------------------------------------------


def test_a_motion_takes_as_many_steps_after_a_rest_as_at_once():
    """Its first displacements counted as grown since t = 0: after 20 s it took 176 steps for 36."""

    def steps(start):
        def swell(t):
            return np.sin(np.pi * (t - start) / 6) ** 2 if t > start else 0.0

        push = rf.Traction("x1", (0, 0, 20.0), time=swell)
        control = rf.StepControl(0.01, "tip", largest=0.2)
        found = times(run(bar(rf.Fixed("x0"), push), control, start + 1.0))
        return int(np.sum(found > start))

    assert steps(20.0) == pytest.approx(steps(0.0), abs=3)


def test_where_a_run_begins_is_no_motion():
    """The way to a bent start counted as a swing of all frequencies: 104 steps for 95."""
    rest, swing = rf.Traction("x1", (0, 0, 400.0)), rf.Traction("x1", (0, 0, 20.0), until=0.5)
    mesh = rf.box((0, 0, 0), (8, 1, 1), (4, 1, 1))
    control = rf.StepControl(0.01, "tip", of=0.05, largest=0.2)

    def scene(*effects):
        return rf.Scene(mesh, SOFT, [rf.Fixed("x0"), *effects], probes={"tip": (8, 0.5, 0.5)})

    *_, start = rf.static(scene(rest))
    bent, straight = run(scene(rest, swing), control, start=start), run(scene(swing), control)
    assert len(bent) == pytest.approx(len(straight), abs=3)


def test_errors_are_forgotten_where_structures_come_back():
    """At half of what a drag takes of velocities; of free bodies, and beside obstacles, never."""
    drag = rf.MassDamping(0.8)
    swing = rf.Traction("x1", (0, 0, 20.0), until=0.5)
    last = run(bar(rf.Fixed("x0"), swing, drag), rf.StepControl(0.02, "tip", largest=0.2), 6.0)[-1]
    sums = [bar(*effects) for effects in ((rf.Fixed("x0"),), (), (rf.Fixed("x0", "xz"),))]
    assert [comes_back(scene) for scene in sums] == [True, False, False]
    assert not comes_back(bar(rf.Fixed("x0", until=3.0)))
    assert not comes_back(bar(rf.Fixed("x0"), rf.MassDamping(0.8, until=3.0)))
    assert last.ledger.rejected < 5
    assert Damped(bar(rf.Fixed("x0"), drag)).rates(np.ones(1), 0.1) == pytest.approx([0.4])
    assert Damped(bar(drag)).rates(np.ones(1), 0.1) == pytest.approx([0.0])


def test_a_ramp_that_stays_keeps_its_budget():
    """Its vibration lasts undamped: twice a period its jerk is zero, and its error goes on."""
    ramp = rf.Table((0.0, 3.0, 100.0), (0.0, 1.0, 1.0))
    scene = bar(rf.Fixed("x0"), rf.Traction("x1", (0, 0, 9.0), time=ramp), cells=(8, 1, 1))
    steps, t_end = rf.StepControl(0.01, "tip", largest=0.2), 30.0
    found, fine = run(scene, steps, t_end), run(scene, 0.04, t_end)
    z = CubicSpline(times(fine), tips(fine)[:, 2])
    error = np.abs(tips(found)[:, 2] - z(times(found))).max() / np.abs(tips(fine)[:, 2]).max()
    assert error < 0.01
    assert 0.4 * error < found[-1].ledger.time.relative < 2 * error


# Runs -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "tol"), [(pushed, 0.05), (shaken, 0.1), (tumbling, 0.1), (tumbling, 0.02)]
)
def test_error_is_what_was_asked(make, tol):
    """Against a run whose own error is below a ninth of this one's, by its Δt."""
    reports = run(make(), rf.StepControl(tol, "tip", largest=0.5), 4.0)
    typical = float(np.median([r.dt for r in reports[1:]]))
    fine = [(r.t, r.probes["tip"]) for r in run(make(), 0.3 * typical, 4.0)]
    t, u = np.array([a for a, _ in fine]), np.array([b for _, b in fine])
    truth = CubicHermiteSpline(t, u, np.gradient(u, t, axis=0))
    error = np.linalg.norm(tips(reports) - truth(times(reports)), axis=1).max()
    asked = tol * np.linalg.norm(u, axis=1).max()
    assert 0.05 * asked < error < 1.5 * asked
    assert 0.4 < reports[-1].ledger.time.spent / error < 3.0
    assert reports[-1].ledger.rejected <= max(0.05 * len(reports), 5)


@pytest.mark.parametrize("by", ["motor", "support"])
def test_a_step_errs_in_no_motion_that_is_led(by):
    """A bar is spun up slowly: with the jerk of its tip, four times its error was told."""
    box = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
    stiff = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
    middle, z = (0, 0.5, 0.5), (0, 0, 1)
    if by == "motor":
        hub = rf.Revolute("ground", rf.MeanFace("x0"), middle, z, name="hub")
        leads = hub, rf.Motor("hub", speed=lambda t: spun_up(t)[1])
    else:
        leads = (
            rf.PrescribedRotation("x0", axis=z, through=middle, angle=lambda t: spun_up(t)[0]),
        )
    scene, found = rf.Scene(box, stiff, leads, probes={"tip": (8, 0.5, 0.5)}), []
    for dt in (0.1, 0.025):
        found.append(run(scene, rf.StepControl(0.9, "tip", largest=dt, smallest=dt)))
    own, fine = found
    off = tips(own) - CubicSpline(times(fine), tips(fine))(times(own))
    error = np.linalg.norm(off, axis=1).max()
    assert 0.5 < own[-1].ledger.time.spent / error < 1.5


def spun_up(t):
    """Angle and speed [rad, rad/s]."""
    s = min(t / 6, 1.0)
    return 6 * (s**3 - s**4 / 2) + max(t - 6.0, 0.0), 3 * s**2 - 2 * s**3


def test_a_breakpoint_is_met_with_even_steps_and_begun_anew():
    """Steps end on it exactly, none is a sliver, and after it they begin small."""
    push = rf.Traction("x1", (0, 0, 200.0), since=1.0, until=3.3)
    reports = run(bar(rf.Fixed("x0"), push), rf.StepControl(0.02, "tip", largest=0.3))
    t = times(reports)
    assert {1.0, 3.3, T} <= set(t)
    dt = np.diff(t)
    for stop in (1.0, 3.3):
        k = int(np.flatnonzero(t == stop)[0])
        assert dt[k] <= max(dt[k - 1] / 8, 1e-3)  # the first step after it
        assert dt[k - 1] >= 0.89 * dt[k - 2]  # the last two before it
    assert dt.max() <= 0.3 * (1 + 1e-9)
    assert sum(abs(b / a - 1) > 1e-9 for a, b in pairwise(dt)) < 0.5 * len(dt)


def test_a_body_at_rest_takes_the_longest_steps():
    """Until something happens, and no number is divided by nothing."""
    push = rf.Traction("x1", (0, 0, 200.0), since=6.0, until=6.2)
    reports = run(bar(rf.Fixed("x0"), push), rf.StepControl(0.02, largest=0.5))
    still = [r for r in reports if 2.0 < r.t <= 6.0]
    assert all(0.35 < r.dt <= 0.5 for r in still)
    assert all(np.isfinite(r.ledger.time.spent) for r in reports)
    nothing = run(bar(rf.Fixed("x0")), rf.StepControl(0.02, largest=0.5))
    assert nothing[-1].t == T
    assert nothing[-1].ledger.time.spent == 0.0


def test_a_part_that_is_rigid_takes_the_longest_steps():
    scene = bar(rf.Rigid(), rf.InitialVelocity(linear=(1.0, 0, 0)))
    reports = run(scene, rf.StepControl(0.01, "tip", largest=0.5))
    assert max(r.dt for r in reports) > 0.45


def test_weak_kinks_end_no_step():
    """A smooth curve given as a table of 400 values, and a roof with its one kink."""
    fine = np.linspace(0.0, T, 401)
    smooth = rf.Table(tuple(fine), tuple(np.sin(np.pi * fine / T)))
    roof = rf.Table((0.0, 1.9, 2.1, T), (0.0, 1.0, 0.0, 0.0))
    for table, ends in ((smooth, False), (roof, True)):
        push = rf.Traction("x1", (0, 0, 100.0), time=table)
        reports = run(bar(rf.Fixed("x0"), push), rf.StepControl(0.02, "tip", largest=0.2))
        t = times(reports)
        inside = [k for k in table.times if 0 < k < T]
        assert (np.isin(inside, t).all()) == ends
        assert len(t) < 300


TRIANGLE = rf.Table((0.83, 1.19, 1.55), (0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("hidden", "told"),
    [
        ({"time": lambda t: float(0.83 < t <= 1.51)}, {"since": 0.83, "until": 1.51}),
        ({"time": lambda t: TRIANGLE(t)}, {"time": TRIANGLE}),
    ],
    ids=["jumps", "kinks"],
)
def test_a_load_that_sets_in_at_no_breakpoint(hidden, told):
    """Steps end where it jumps or bends as if that were told; it erred 48 and 3 times as much."""
    steps = {0.0: 0.83, 0.83: 0.005}
    control = rf.StepControl(0.001, "tip", largest=0.2)

    def path(given, dt):
        reports = run(bar(rf.Fixed("x0"), rf.Traction("x1", (0, 0, 200.0), **given)), dt, 3.0)
        return times(reports), tips(reports)

    t, u = path(told, steps)
    truth = CubicHermiteSpline(t, u, np.gradient(u, t, axis=0))
    hidden, told = (path(given, control) for given in (hidden, told))
    errors = [np.linalg.norm(u - truth(t), axis=1).max() for t, u in (hidden, told)]
    assert errors[0] < 1.3 * errors[1]
    assert len(hidden[0]) < 1.3 * len(told[0])


def test_steps_follow_a_blow():
    """A bar falls flat and is thrown back: it was off by fourteen times what was asked."""
    box, floor = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1)), rf.Plane((0, 0, -0.05), (0, 0, 1))
    effects = [rf.Gravity((0, 0, -1.0)), rf.KelvinVoigt(2e4), rf.Contact("z0", against=floor)]

    def path(dt):
        scene = rf.Scene(box, SOFT, effects, probes={"tip": (8, 0.5, 0.5)})
        reports = run(scene, dt, 0.9)
        return times(reports), tips(reports)

    t, u = path({0.0: 0.01, 0.3: 0.001})
    truth, size = (
        CubicHermiteSpline(t, u, np.gradient(u, t, axis=0)),
        np.linalg.norm(u, axis=1).max(),
    )
    for tol in (0.01, 0.003):  # the step after the first touch was not judged: 0.038, of any tol
        t, ours = path(rf.StepControl(tol, "tip", largest=0.2, smallest=2e-5))
        assert np.linalg.norm(ours - truth(t), axis=1).max() < 2.5 * tol * size
        assert len(t) < 500


@pytest.mark.filterwarnings("ignore:Reduced .* deforms too far:rigidfx.RigidfxWarning")
@pytest.mark.parametrize("reduced", [False, True])
def test_what_falls_freely_hits_as_in_short_steps(reduced):
    """A step that pressed at its end erred, and a body got the shapes that it resolves: 2 %."""
    touch, rubber = float(np.sqrt(0.02 / 9.81)), rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1200.0)
    effects = [
        rf.Contact("z0", against=rf.Plane((0, 0, 0), (0, 0, 1)), title="floor"),
        rf.Gravity((0, 0, -9.81)),
        rf.StiffnessDamping(ratio=0.05, frequency=100.0),
        *[rf.Reduced()] * reduced,
    ]
    block = rf.box((0, 0, 0.01), (0.06, 0.04, 0.04), (3, 2, 2))

    def hit(dt):
        reports = run(rf.Scene(block, rubber, effects), dt, touch + 1.2e-3)[1:]
        peak = max(r.touches["floor"].force[2] for r in reports)
        return np.array([peak, reports[-1].linear_momentum[2]]), times(reports)

    truth, _ = hit({0.0: 1e-3, touch - 5.25e-6: 5e-6})
    ours, t = hit(rf.StepControl(0.01, largest=3e-3, smallest=3e-6))
    np.testing.assert_allclose(ours, truth, rtol=0.005)
    assert np.count_nonzero(t < touch) < 25


def test_what_is_struck_at_rest_has_no_error_before_it_moves():
    """A ram meets a bar: its far end had no speed yet, and a thousand times tol was told."""
    ram = rf.Plane((-0.01, 0, 0), (1, 0, 0), path=lambda t: (0.5 * t, 0, 0))
    effects = [rf.Contact("x0", against=ram), rf.StiffnessDamping(ratio=0.05, frequency=20.0)]
    box = rf.box((0, 0, 0), (0.4, 0.2, 0.2), (4, 1, 1))
    scene = rf.Scene(box, SOFT, effects, probes={"far": (0.4, 0.2, 0.2)})
    reports = run(scene, rf.StepControl(0.05, "far", largest=0.05, smallest=2e-5), 0.1)
    assert len(reports) < 250  # there were 370
    assert 0 < reports[-1].ledger.time.relative < 0.05


@pytest.mark.filterwarnings("ignore:.*as short as they may be:rigidfx.RigidfxWarning")
@pytest.mark.parametrize("size", [1e-306, 1.0])
def test_a_load_that_is_rough_everywhere_does_not_make_steps_creep(size):
    """Be it by rounding: numbers this small have a digit or two."""
    load = rf.Traction("x1", lambda x, t: np.array([[0.0], [size * np.sin(1e9 * t)], [0.0]]))
    smooth = rf.Traction("x1", lambda x, t: np.array([[0.0], [size * t], [0.0]]))
    control = rf.StepControl(0.1, largest=0.2, smallest=0.05)
    for given in (load, smooth):
        assert len(times(run(bar(rf.Fixed("x0"), given), control, 1.0))) <= 1.0 / 0.05 + 2


def test_a_load_that_is_new_at_each_call_is_refused():
    """It made steps as short as they may be, for ever; later on, too, as it jumps."""
    random = np.random.default_rng(1)
    for load in (lambda t: random.random(), lambda t: random.random() if t > 0.5 else 1.0):
        noise = rf.Traction("x1", (0, 0, 20.0), time=load)
        with pytest.raises(rf.SceneError, match=r"Traction on 'x1': asked twice at t = .*Table"):
            run(bar(rf.Fixed("x0"), noise), rf.StepControl(0.05, "tip", largest=0.1), 2.0)


def test_no_step_is_longer_than_the_longest_after_a_kink():
    """What was left up to the end had been divided before the kink."""
    load = rf.Traction("x1", lambda t: (0, 0, 20.0 * max(0.0, t - 0.9)))
    t = times(run(bar(rf.Fixed("x0"), load), rf.StepControl(0.1, "tip", largest=0.25, of=1.0), 2.6))
    assert np.diff(t).max() <= 0.25 * (1 + 1e-9)


def test_a_path_whose_velocity_jumps_at_no_breakpoint_takes_its_nodes_along():
    """As at a breakpoint, so that nothing swings to and fro: a consistent mass tells others of it.

    Asked for 1 %, a bar of 12 x 2 x 2 cells took 6000 steps to t = 3 s in place of 810 to 4 s.
    """

    def ran(**declared):
        def path(t):
            return 0, 0, 0.05 * float(np.clip(t - 0.37, 0, 1))

        vars(path).update(declared)
        moved = rf.PrescribedMotion("x0", displacement=path)
        material = rf.StVenantKirchhoff(E=4e5, nu=0.35, rho=1100.0)
        box, damping = rf.box((0, 0, 0), (6, 1, 1), (12, 1, 1)), rf.MassDamping(0.2)
        probes = {"tip": (6, 0.5, 0.5)}
        scene = rf.Scene(box, material, [moved, damping], probes=probes, mass="consistent")
        return run(scene, rf.StepControl(0.02, "tip", largest=0.2), 1.6)

    found, declared = ran(), ran(breakpoints=[0.37, 1.37])
    at, to = ([(r.t - r.dt, r.impact.energy) for r in rs if r.impact] for rs in (found, declared))
    assert len(at) == len(to) == 2
    assert at == [(pytest.approx(t, abs=1e-5), pytest.approx(e, rel=1e-3)) for t, e in to]
    assert len(found) < 1.5 * len(declared)
    assert tips(found)[-1] == pytest.approx(tips(declared)[-1], abs=1e-3)


def test_a_load_that_fails_between_steps_is_named():
    def fails(t):
        return 1.0 if t < 1.0 else 1 / 0

    push = rf.Traction("x1", (0, 0, 200.0), time=fails)
    with pytest.raises(rf.SceneError, match=r"Traction on 'x1'.*ZeroDivisionError"):
        run(bar(rf.Fixed("x0"), push), rf.StepControl(0.05, "tip", largest=0.2))


def test_a_step_that_may_not_be_shorter_says_so():
    control = rf.StepControl(0.001, "tip", largest=0.4, smallest=0.3)
    with pytest.warns(rf.RigidfxWarning, match="as short as they may be"):
        reports = run(pushed(), control)
    spent = reports[-1].ledger.time
    assert spent.spent > spent.allowed


def test_what_begins_from_rest_at_no_breakpoint_is_no_warning():
    """Its first steps err by a good part of next to nothing, however short they are."""
    push = rf.Traction("x1", (0, 0, 200.0), time=lambda t: max(0.0, t - 1.0) ** 2)
    control = rf.StepControl(0.001, "tip", largest=0.2, smallest=1e-3)
    reports = run(bar(rf.Fixed("x0"), push), control, 1.5)
    assert min(r.dt for r in reports[1:]) < 2 * control.least
    assert reports[-1].ledger.time.relative < 0.001


def test_bodies_that_come_and_go():
    """They wake and freeze beside a controlled Δt; balances hold, and no Δt is cut for it."""
    rule = rf.StrainRate(2e-3, 1.0, wake="local", release=rf.Release(at=5.0))
    reports = run(pushed(), rf.StepControl(0.02, largest=0.1), rigidify=rule)
    assert any(r.events for r in reports)
    work = sum(r.work_of_loads for r in reports)
    taken = sum(sum(r.dissipated.values()) for r in reports)  # of what is let down
    assert abs(reports[-1].energy - work + taken) < 1e-9 * work


# The ledger -----------------------------------------------------------------------------------


def test_the_energy_of_deformation_is_none_of_a_rigid_motion():
    """A free body that flies and turns, as one body, and one that vibrates as well."""
    spin = rf.InitialVelocity(linear=(3.0, 1.0, 0.0), angular=(0.2, 0.0, 0.1))
    rigid = run(bar(spin, rf.Rigid()), rf.StepControl(0.01, largest=0.1), 1.0)
    assert rigid[-1].ledger.frozen.scale <= 1e-9 * rigid[-1].kinetic
    one = rf.InitialVelocity(function=lambda X: np.stack([0 * X[0], 0 * X[0], 0.01 * np.cos(X[0])]))
    still = run(bar(one), rf.StepControl(0.01, largest=0.01), 0.01)[0].ledger.frozen.scale
    both = run(bar(one, spin), rf.StepControl(0.01, largest=0.01), 0.01)[0].ledger.frozen.scale
    assert both == pytest.approx(still, rel=1e-9)


def test_the_ledger_says_what_damping_takes_and_what_freezes():
    rule = rf.StrainRate(2e-3, 1.0, wake="none")
    push = pushed().effects
    control = rf.StepControl(0.5, largest=0.05)
    reports = run(bar(*push, rf.NumericalDamping(0.02)), control, rigidify=rule)
    ledger = reports[-1].ledger
    taken = sum(r.dissipated.get("NumericalDamping", 0.0) for r in reports)
    assert ledger.damping.spent == pytest.approx(taken, rel=1e-12)
    assert ledger.damping.relative == pytest.approx(taken / ledger.damping.scale)
    frozen = [(r.ledger.frozen.spent, r.stored) for r in reports]
    assert max(f for f, _ in frozen) > 0
    assert all(f <= s + 1e-15 for f, s in frozen)
    assert "frozen vibration" in str(ledger)


def test_the_table_of_a_run_has_the_ledger(tmp_path):
    scene = pushed()
    with rf.Recorder(scene, tmp_path) as recorder:
        for report in rf.simulate(scene, rf.StepControl(0.05, "tip", largest=0.2), 1.0):
            recorder.write(report)
    h = rf.read_history(tmp_path / "history.csv")
    assert h["time_error"][-1] == report.ledger.time.spent
    assert h["time_allowed"][-1] == pytest.approx(0.05 * h["displacement"][-1])
    panels = spent(h)
    assert [curve.label for curve in panels.popitem()[1]] == ["estimated error", "allowed"]


# Bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize("given", ["StepControl", "Accuracy"])
def test_accuracy_where_supports_lead_is_warned_of(given):
    """Nothing errs there: Δt was the longest, without a word."""
    box = rf.box((0, 0, 0), (8, 1, 1), (4, 1, 1))
    probes = {"root": (0, 0.5, 0.5), "tip": (8, 0.5, 0.5)}
    scene = rf.Scene(box, SOFT, [rf.Fixed("x0")], probes=probes)

    def said(at):
        asked = (
            {"dt": rf.StepControl(0.01, at, largest=0.1)}
            if given == "StepControl"
            else {"dt": 0.1, "accuracy": rf.Accuracy(0.01, at)}
        )
        with heard("Supports hold or move the probes") as found:
            list(rf.simulate(scene, t_end=0.2, progress=False, **asked))
        return found

    assert "('root')" in said("root")[0]
    assert not said(("root", "tip"))


def pulled():
    pull = rf.Traction("x1", (0, 0, 200.0), until=1.0)
    return bar(rf.Fixed("x0"), pull)


@pytest.fixture(scope="module")
def on_one_rank():
    return parallel.run(__file__, 1, 120)


@pytest.mark.parallel
def test_ranks_take_the_same_steps(on_one_rank):
    """As one rank does: the same number of them, and the same probe at the end."""
    for one, some in zip(on_one_rank, parallel.run(__file__, 3, 120), strict=True):
        assert some[:2] == one[:2]
        assert some[2:] == pytest.approx(one[2:], rel=1e-8, abs=1e-10)


if __name__ == "__main__":
    out = []
    for at in ("tip", None):
        last = run(pulled(), rf.StepControl(0.05, at, largest=0.3), 3.0)[-1]
        ledger = last.ledger
        out.append([last.step, ledger.rejected, last.t, *last.probes["tip"], ledger.time.spent])
    parallel.report([[float(x) for x in row] for row in out])

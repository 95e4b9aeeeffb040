"""Joints: energy, both momenta, constraints, a pendulum's period, ranks, switches, bad input.

Run as a script under mpirun, this file reports histories of two joined bars.
"""

import numpy as np
import parallel
import pytest
from common import boxes
from histories import changes, imbalance
from joints import PIN, SOFT, bars, follow
from scipy.special import ellipk

import rigidfx as rf

NO_WARNINGS = pytest.mark.filterwarnings("ignore:Body")  # of few cells, whose lumped mass shows
PARTS = {
    "flexible": ((), None),
    "one rigid": ((rf.Rigid("A"),), ("A", rf.MeanFace("b"))),
    "both rigid": ((rf.Rigid("A"), rf.Rigid("B")), ("A", "B")),
    "faces of rigid parts": ((rf.Rigid("A"), rf.Rigid("B")), None),
    "rigid faces": ((), (rf.RigidFace("a"), rf.RigidFace("b"))),
}


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("parts", PARTS)
def test_a_hinge_keeps_energy_and_both_momenta(parts, mass):
    """Two bars that tumble, whatever is rigid; the joint holds to rounding."""
    effects, sides = PARTS[parts]
    reports, H, L, J, held = follow(bars(*effects, sides=sides, mass=mass), 0.01, 40)
    assert max(H, L, J) <= 1e-12
    assert held[0] <= 1e-13
    assert held[1] <= 5e-3  # the sides' velocities differ by what the time integration leaves
    assert np.mean([r.iterations for r in reports[1:]]) <= 8
    turned = reports[-1].state.positions(np.arange(len(reports[-1].state.X)))
    assert np.abs(turned - reports[-1].state.X).max() > 0.5


def test_a_ball_joint_keeps_energy_and_both_momenta():
    """All three rotations are free."""
    _, H, L, J, held = follow(bars(ball=True), 0.01, 40)
    assert max(H, L, J) <= 1e-12
    assert held[0] <= 1e-13


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("face", [rf.MeanFace, rf.RigidFace])
def test_joined_parts_become_rigid_and_flexible_again(face, mass):
    """Faces of the joint are in bodies, then in none, then in bodies; all at given times."""
    release = rf.Release(at=(0.25,))
    criterion = rf.StrainRate(1e9, 0.1, patience=1, wake="none", release=release)
    sides = face("a"), face("b")
    reports, H, L, J, held = follow(bars(sides=sides, mass=mass), 0.01, 45, rigidify=criterion)
    kinds = [event.kind for report in reports for event in report.events]
    assert kinds == ["freeze", "release", "freeze"]
    assert reports[-1].unknowns == 12
    assert max(H, L, J) <= 1e-12
    assert held[0] <= 1e-13
    assert held[1] <= 5e-3  # no switch leaves the sides different velocities


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_velocities_that_do_not_fit_a_joint_are_met_by_impulses(mass):
    """A bar is thrown, the other rests: momenta stay, and what energy is lost is told."""

    def thrown(x):
        return np.where(x[:1] > PIN[0], np.array([[0.0], [1.0], [0.5]]), 0.0)

    scene = bars(rf.Rigid("A"), sides=("A", rf.MeanFace("b")), thrown=thrown, mass=mass)
    with pytest.warns(rf.RigidfxWarning, match=r"velocities do not fit the joints \(Revolute"):
        reports, H, L, J, held = follow(scene, 0.01, 10)
    assert max(H, L, J) <= 1e-12
    assert held[1] <= 5e-3
    loose = bars(rf.Rigid("A"), thrown=thrown, mass=mass, joined=False)
    first, *_ = rf.simulate(loose, 0.01, 0.01)
    given, impact = first.energy, reports[0].impact
    assert reports[0].energy == pytest.approx(given + impact.energy, rel=1e-12)
    assert 0.02 < -impact.energy / given < 0.9
    assert np.abs(impact.impulse).max() <= 1e-12 * reports[0].momentum_scale


def pendulum(cells):
    """A bar of 1 m on a hinge at its end, let go from the horizontal."""
    domain = rf.box((0, 0, 0), (1, 0.1, 0.1), (cells, 1, 1)).with_cells("bar", lambda x: x[0] > -1)
    hinge = rf.Revolute("ground", "bar", (0, 0.05, 0.05), (0, 0, 1))
    effects = [hinge, rf.Gravity((0, -9.81, 0)), rf.Rigid("bar")]
    return rf.Scene(domain, SOFT, effects, probes={"tip": (1, 0.05, 0.05)})


@NO_WARNINGS
def test_the_period_of_a_pendulum_converges_with_second_order():
    """Of a uniform bar it is 1.93334 s; of this one by its own moment of inertia."""
    scene = pendulum(10)
    m, X = scene.nodal_mass, scene.space.tabulate_dof_coordinates() - np.array([0, 0.05, 0.05])
    inertia, static = m @ (X[:, 0] ** 2 + X[:, 1] ** 2), m @ X[:, 0]
    exact = 4 * ellipk(0.5) * np.sqrt(inertia / (9.81 * static))
    assert 4 * ellipk(0.5) * np.sqrt(2 / (3 * 9.81)) == pytest.approx(1.93334, abs=1e-5)
    off = []
    for dt in (0.02, 0.01):
        reports = list(rf.simulate(scene, dt, 2.1))
        t, y = (
            np.array(a) for a in zip(*((r.t, r.probes["tip"][1]) for r in reports), strict=True)
        )
        k = int(np.argmax(np.where(t > 1.5, y, -1.0)))
        curve = np.polyfit(t[k - 3 : k + 4] - t[k], y[k - 3 : k + 4], 4)
        roots = np.roots(np.polyder(curve))
        off.append(t[k] + min(roots[np.isreal(roots)].real, key=abs) - exact)
        assert imbalance(reports) <= 1e-12
    assert abs(off[1]) <= 2.5e-4 * exact
    assert off[0] / off[1] == pytest.approx(4, rel=0.15)


# Pairs, motors and springs on a rigid bar -------------------------------------------------------

AT = 0.0, 0.05, 0.05  # m, the middle of the bar's end


def bar(*effects):
    """A rigid bar of 10 kg along x, with moments of inertia of its own."""
    domain = rf.box((0, 0, 0), (1, 0.1, 0.1), (2, 1, 1)).with_cells("bar", lambda x: x[0] > -1)
    inertia = np.diag([0.3, 0.8, 1.0])
    return rf.Scene(domain, SOFT, [rf.Rigid("bar", mass=10.0, inertia=inertia), *effects])


ABOUT_END = 1.0 + 10.0 * 0.5**2  # kg m², about an axis across the bar through its end
HINGE = rf.Revolute("ground", "bar", AT, (0, 0, 1), name="joint")
SLIDER = rf.Prismatic("ground", "bar", AT, (1, 0, 0), name="joint")


def driven(*effects, dt=0.01, steps=60):
    """Last report, and the largest error of the balance of energy, relative."""
    reports = list(rf.simulate(bar(*effects), dt, steps * dt))
    return reports[-1], imbalance(reports)


def test_a_torque_turns_a_hinge():
    """The angle of constant acceleration, torque and bearing force as they must be."""
    last, off = driven(HINGE, rf.Motor("joint", torque=5.0))
    joint, angle = last.joints["joint"], 0.5 * 5.0 / ABOUT_END * 0.6**2
    assert joint.angle == pytest.approx(angle, rel=1e-4)
    assert joint.angle_rate == pytest.approx(5.0 / ABOUT_END * 0.595, rel=1e-4)
    assert joint.moment[2] == pytest.approx(5.0, rel=1e-3)
    spin = 5.0 / ABOUT_END * 0.595
    pull = 10.0 * 0.5 * np.hypot(spin**2, 5.0 / ABOUT_END)
    assert np.linalg.norm(joint.force) == pytest.approx(pull, rel=1e-3)
    assert off <= 1e-12
    assert joint.gap <= 1e-13


@pytest.mark.filterwarnings("ignore")
def test_an_attempt_that_fails_leaves_no_multipliers():
    """A step of 4 rad fails; the half of it began with its forces, and came to 1e54 J."""
    at, turn = (0, 0.05, 0.05), (0, 0, 400.0)
    rod = rf.box((0, 0, 0), (1, 0.1, 0.1), (2, 1, 1)).with_cells("rod", lambda x: x[0] > -1)
    effects = [
        rf.Rigid("rod", mass=10.0, inertia=np.diag([0.3, 0.8, 1.0])),
        rf.Revolute("ground", "rod", at, (0, 0, 1), name="joint"),
        rf.InitialVelocity(angular=turn, centre=at),
        rf.Motor("joint", speed=400.0),
    ]
    reports = list(rf.simulate(rf.Scene(rod, SOFT, effects), 0.01, 0.02))
    last = reports[-1]
    assert any(report.cuts for report in reports)
    assert last.joints["joint"].angle == pytest.approx(8.0, rel=1e-12)
    assert last.joints["joint"].gap <= 1e-14


def test_a_given_speed_turns_a_hinge_many_times():
    """Turns are counted; the work is what the bar gets."""
    last, off = driven(HINGE, rf.Motor("joint", speed=lambda t: 5 * t * t), steps=200)
    assert last.joints["joint"].angle == pytest.approx(40 / 3, abs=1e-9)
    assert last.kinetic == pytest.approx(0.5 * ABOUT_END * 20**2, rel=1e-2)
    assert off <= 1e-11


def test_each_effort_is_told_where_a_joint_has_several():
    """Of two torques, and of a force and a torque on one cylindrical pair."""
    both = rf.Motor("joint", torque=3.0), rf.Motor("joint", torque=-1.0)
    joint = driven(HINGE, *both, steps=2)[0].joints["joint"]
    assert list(joint.efforts.values()) == pytest.approx([3.0, -1.0])
    assert joint.moment[2] == pytest.approx(2.0)
    sleeve = rf.Cylindrical("ground", "bar", AT, (1, 0, 0), name="joint")
    both = rf.Motor("joint", torque=2.0), rf.Motor("joint", force=4.0)
    springs = rf.JointSpring("joint", 1.0, along="angle"), rf.JointSpring("joint", along="travel")
    efforts = driven(sleeve, *both, *springs, steps=2)[0].joints["joint"].efforts
    assert efforts["Motor of 'joint', torque"] == pytest.approx(2.0)
    assert efforts["Motor of 'joint', force"] == pytest.approx(4.0)
    assert len(efforts) == 4


def test_a_motor_that_starts_with_a_jolt_is_told():
    """At full speed from rest it throws the bar to and fro."""
    for motor in (rf.Motor("joint", angle=lambda t: 5.0 * t), rf.Motor("joint", speed=5.0)):
        jolt = "Motor of 'joint'' acts with a jolt: an impact b"
        with pytest.warns(rf.RigidfxWarning, match=jolt):
            reports = list(rf.simulate(bar(HINGE, motor), 0.01, 0.05))
        assert reports[0].impact.energy == pytest.approx(0.5 * ABOUT_END * 25)
        effort = reports[-1].joints["joint"].efforts["Motor of 'joint'"]
        assert abs(effort) <= 1e-3 * 2 * ABOUT_END * 5.0 / 0.01  # of second order in Δt
    with pytest.warns(rf.RigidfxWarning, match=r"with angle 0\.1 rad, but the joint has"):
        list(rf.simulate(bar(HINGE, rf.Motor("joint", angle=0.1)), 0.01, 0.02))


def test_a_given_angle_is_followed_under_gravity():
    motor = rf.Motor("joint", angle=lambda t: 1 - np.cos(2 * t))
    last, off = driven(HINGE, motor, rf.Gravity((0, -9.81, 0)))
    assert last.joints["joint"].angle == pytest.approx(1 - np.cos(1.2), abs=1e-12)
    assert off <= 1e-12


def test_a_lock_ends_with_its_window():
    """A hinge that is locked at rest does not fall; afterwards it does."""
    lock = rf.Motor("joint", speed=0.0, until=0.3)
    reports = list(rf.simulate(bar(HINGE, lock, rf.Gravity((0, -9.81, 0))), 0.01, 0.5))
    angles = np.array([r.joints["joint"].angle for r in reports[1:]])
    assert np.abs(angles[:30]).max() <= 1e-12
    assert reports[20].joints["joint"].efforts["Motor of 'joint'"] == pytest.approx(49.05)
    assert angles[-1] == pytest.approx(-0.5 * 49.05 / ABOUT_END * 0.2**2, rel=0.02)


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_lock_in_motion_takes_what_is_told(mass):
    """Momenta stay, the effort is smooth; parts become rigid and flexible while it acts."""
    title = "Revolute MeanFace 'a' - MeanFace 'b'"
    scene = bars(rf.Motor(title, speed=0.0, since=0.1, until=0.3), mass=mass)
    release = rf.Release(at=(0.2,))
    criterion = rf.StrainRate(1e9, 0.05, patience=1, wake="none", release=release)
    reports = list(rf.simulate(scene, 0.01, 0.4, rigidify=criterion))
    assert [e.kind for e in reports[10].events] == ["release"]  # which the lock asks for
    taken = np.cumsum([r.impact.energy if r.impact else 0.0 for r in reports])
    assert -0.1 * reports[0].energy < taken[-1] < -1e-4 * reports[0].energy
    assert imbalance(reports) <= 1e-12
    assert changes(reports)[2] <= 1e-12
    told = [r.joints[title] for r in reports[1:]]
    assert np.ptp([joint.angle for joint in told[10:30]]) <= 1e-12
    efforts = np.array([joint.efforts[f"Motor of '{title}'"] for joint in told[10:30]])
    assert (efforts[:5] < -5).all()  # not thrown to and fro
    assert efforts[5:9] == pytest.approx(efforts[5], rel=0.01)  # of one rigid body
    assert abs(told[-1].angle - told[29].angle) > 0.01


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("face", [rf.MeanFace, rf.RigidFace])
def test_a_driven_hinge_books_the_work_of_its_motor_at_switches(face, mass):
    """A motor keeps its speed by an impulse where parts become rigid and flexible."""
    title = f"Revolute {face.__name__} 'a' - {face.__name__} 'b'"
    motor = rf.Motor(title, speed=3.0, since=0.07)
    criterion = rf.StrainRate(1e9, 0.1, patience=1, wake="none", release=rf.Release(at=(0.25,)))
    scene = bars(motor, sides=(face("a"), face("b")), mass=mass)
    reports = list(rf.simulate(scene, 0.01, 0.45, rigidify=criterion))
    events = [event for report in reports for event in report.events]
    assert [event.kind for event in events] == ["freeze", "release", "freeze"]
    whole = max(report.energy for report in reports)
    assert max(abs(event.energy_lost) for event in events) <= 1e-12 * whole
    assert abs(events[1].work_of_motors) > 1e-3 * whole
    assert imbalance(reports) <= 1e-12
    assert changes(reports)[2] <= 1e-12


def test_a_spring_about_a_hinge_swings_and_its_damper_takes():
    """The frequency of a torsion spring, converging with second order."""
    off = []
    for dt in (0.02, 0.01):
        spring = rf.JointSpring("joint", 1000.0, rest=0.5)
        last, lost = driven(HINGE, spring, dt=dt, steps=round(0.6 / dt))
        exact = 0.5 - 0.5 * np.cos(0.6 * np.sqrt(1000 / ABOUT_END))
        off.append(last.joints["joint"].angle - exact)
        assert lost <= 1e-11
    assert off[0] / off[1] == pytest.approx(4, rel=0.2)
    damped = rf.JointSpring("joint", 1000.0, damping=30.0, rest=0.5)
    last, lost = driven(HINGE, damped)
    assert lost <= 1e-11
    assert last.energy < 40 < 0.5 * 1000 * 0.5**2


@pytest.mark.parametrize("damping", [0.0, 200.0])
def test_a_stop_throws_a_hinge_back_after_a_turn(damping):
    """Beyond π, exact in energy; its damper takes what is lost."""
    start = rf.InitialVelocity(angular=(0, 0, 5.0), centre=AT)
    stop = rf.Stop("joint", low=-0.5, high=7.0, stiffness=1e4, damping=damping)
    reports = list(rf.simulate(bar(HINGE, start, stop), 0.01, 2.0))
    angles = np.array([r.joints["joint"].angle for r in reports[1:]])
    assert imbalance(reports) <= 1e-12
    assert 7.0 < angles.max() < 7.0 + 1.1 * 5.0 * np.sqrt(ABOUT_END / 1e4)
    rate = reports[-1].joints["joint"].angle_rate
    assert rate == pytest.approx(-5.0, rel=1e-3) if not damping else -5.0 < rate < -0.1


def struck(dt, damping=0.0, t_end=0.03):
    """Reports of the bar that slides at 1 m/s against a stop, 5 mm away."""
    stop = rf.Stop("joint", high=0.005, stiffness=1e6, damping=damping)
    return list(rf.simulate(bar(SLIDER, stop, rf.InitialVelocity((1.0, 0, 0))), dt, t_end))


@pytest.mark.parametrize("damping", [2000.0, 5000.0])
def test_a_stop_only_pushes(damping):
    """On the way back the damper pulled by up to 675 N; energy is exact, and none appears."""
    reports = struck(2e-4, damping)
    forces = np.array([r.joints["joint"].efforts["Stop of 'joint'"] for r in reports[1:]])
    taken = np.array([r.dissipated.get("Stop", 0.0) for r in reports])
    assert forces.max() == 0.0
    assert taken.min() >= 0.0
    assert imbalance(reports) <= 1e-12


@pytest.mark.parametrize(("dt", "t_end"), [(0.02, 0.06), (0.005, 0.03), (0.003, 0.006)])
def test_a_blow_on_a_stop_that_steps_do_not_resolve_is_told(dt, t_end):
    """Half a period is π √(m/k) = 9.9 ms; a tenth of it finds the peak to 3 %.

    The last run ends with the step in which the stop is struck.
    """
    with pytest.warns(rf.RigidfxWarning, match=r"Stop of 'joint' was struck .* ≤ 0\.00099 s"):
        struck(dt, t_end=t_end)
    forces = [r.joints["joint"].efforts["Stop of 'joint'"] for r in struck(0.00099)[1:]]
    assert -min(forces) == pytest.approx(np.sqrt(1e6 * 10.0), rel=0.03)


def test_a_blow_in_the_only_step_of_a_run_is_told():
    """One step does not show the mass that strikes; a run that rests on its stop has no blow."""
    with pytest.warns(rf.RigidfxWarning, match="was struck in the only step of the run"):
        struck(0.01, t_end=0.01)
    rests = bar(SLIDER, rf.Stop("joint", high=0.0, stiffness=1e6), rf.Gravity((9.81, 0, 0)))
    *_, loaded = rf.static(rests, 1)
    list(rf.simulate(rests, 0.01, 0.01, start=loaded))


def test_a_stop_that_is_violated_at_the_start_is_refused():
    """450 J appeared; a static solution may rest on a stop."""
    beyond = rf.Stop("joint", high=-0.03, stiffness=1e6)
    with pytest.raises(rf.SceneError, match=r"its travel is .* beyond -inf to -0\.03 m at"):
        list(rf.simulate(bar(SLIDER, beyond), 0.01, 0.02))
    stop, weak = rf.Stop("joint", high=0.0, stiffness=1e6), rf.JointSpring("joint", 1.0)
    rests = bar(SLIDER, stop, weak, rf.Gravity((9.81, 0, 0)))
    *_, loaded = rf.static(rests, 1)
    *_, last = rf.simulate(rests, 0.01, 0.05, start=loaded)
    assert last.joints["joint"].travel == pytest.approx(98.1 / (1e6 + 1), rel=1e-6)


def test_a_slider_and_a_cylinder_let_the_bar_slide():
    for joint in (SLIDER, rf.Cylindrical("ground", "bar", AT, (1, 0, 0), name="joint")):
        last, off = driven(joint, rf.Motor("joint", force=5.0))
        assert last.joints["joint"].travel == pytest.approx(0.5 * 0.5 * 0.6**2, rel=1e-9)
        assert last.joints["joint"].force[0] == pytest.approx(5.0)
        assert off <= 1e-12
    last, _ = driven(SLIDER, rf.Motor("joint", rate=lambda t: 2 * t))
    assert last.joints["joint"].travel == pytest.approx(0.36, abs=1e-12)


def test_a_tie_carries_force_and_moment():
    last, _ = driven(rf.Tied("ground", "bar", AT, name="joint"), rf.Gravity((0, -9.81, 0)))
    assert last.joints["joint"].force == pytest.approx([0, 98.1, 0], abs=1e-9)
    assert last.joints["joint"].moment == pytest.approx([0, 0, 49.05], abs=1e-9)
    assert last.kinetic <= 1e-24


def test_a_universal_joint_does_not_let_the_bar_turn_about_it():
    """It swings about both axes of the cross; a torque about the bar's own axis finds no way."""
    cross = rf.Universal("ground", "bar", AT, (0, 1, 0), (0, 0, 1), name="joint")
    start = rf.InitialVelocity(angular=(0.0, 0.5, 1.0), centre=AT)
    twist = rf.Resultant("bar", torque=(0.5, 0.0, 0.0))
    reports = list(rf.simulate(bar(cross, start), 0.01, 0.5))
    assert np.ptp([r.energy for r in reports]) <= 1e-12 * reports[0].energy
    assert reports[-1].joints["joint"].gap <= 1e-13
    still = list(rf.simulate(bar(cross, twist), 0.01, 0.1))[-1]
    assert still.kinetic <= 1e-20
    assert still.joints["joint"].moment == pytest.approx([-0.5, 0, 0], abs=1e-9)


@NO_WARNINGS
def test_two_hinges_of_one_door_hold_five_directions_once():
    """The others are named, and the door swings as on one of them."""
    upper = rf.Revolute("ground", "bar", (0, 0.05, 1.0), (0, 0, 1), name="upper")
    motor = rf.Motor("joint", torque=5.0)
    with pytest.warns(rf.RigidfxWarning, match=r"5 of the rows of joints follow from others"):
        last, off = driven(HINGE, upper, motor)
    alone, _ = driven(HINGE, motor)
    assert last.joints["joint"].angle == pytest.approx(alone.joints["joint"].angle, rel=1e-12)
    assert max(off, last.joints["upper"].gap) <= 1e-12


def test_history_and_description_have_the_joints(tmp_path):
    motors = rf.Motor("joint", torque=5.0), rf.Motor("joint", torque=2.0, until=0.02)
    scene = bar(HINGE, *motors, rf.JointSpring("joint", 1.0))
    assert "1 joint holds 5 directions" in str(scene.describe())
    assert "6 degrees of freedom without them. At least 1 are left." in str(scene.describe())
    assert "'ground' - 'bar'" in str(scene.describe())
    with rf.Recorder(scene, tmp_path / "bar") as recorder:
        for report in rf.simulate(scene, 0.01, 0.05):
            recorder.write(report)
            if report.step == 0:
                with pytest.raises(KeyError, match="'joint' from the first step on"):
                    report.joints["joint"]
    with pytest.raises(KeyError, match=r"report\.joints has no 'pin'; its names are 'joint'"):
        report.joints["pin"]
    with pytest.raises(KeyError, match=r"its names are .*, torque 1"):
        report.joints["joint"].efforts["Motor of 'joint'"]
    columns = rf.read_history(recorder.history)
    assert columns["joint_joint_motor_torque_1"][1:] == pytest.approx(np.full(5, 5.0))
    assert columns["joint_joint_motor_torque_2"][1:] == pytest.approx(np.array([2, 2, 0, 0, 0]))
    effort = report.joints["joint"].efforts["JointSpring of 'joint'"]
    assert columns["joint_joint_spring"][-1] == pytest.approx(effort)
    assert columns["joint_joint_angle"][-1] == pytest.approx(report.joints["joint"].angle)
    assert columns["joint_joint_force_x"][-1] == pytest.approx(report.joints["joint"].force[0])
    drawn = rf.read_fields(tmp_path / "bar" / "joints.pvd")  # points for arrows in ParaView
    assert drawn.points == pytest.approx(np.array([AT]))
    assert drawn["force"][-1] == pytest.approx(report.joints["joint"].force[None])
    assert drawn["moment"][-1] == pytest.approx(report.joints["joint"].moment[None])


def test_a_description_counts_motors_of_given_motion_and_no_supports():
    """A lock leaves nothing, and what a support leaves is not told: 1 was said to be left."""
    locked, held = bar(HINGE, rf.Motor("joint", speed=0.0)), bar(HINGE, rf.Fixed("x0"))
    assert "holds 5 directions, and motors at the start 1 more; " in str(locked.describe())
    assert "At least 0 are left." in str(locked.describe())
    assert "At least" not in str(held.describe())
    later = bar(HINGE, rf.Motor("joint", speed=0.0, since=0.1))
    assert "At least 1 are left." in str(later.describe())


@NO_WARNINGS
def test_the_multibody_file_has_the_joints(tmp_path):
    """As they were placed, to be read back; a rigid face is none of its bodies."""
    hinge = rf.Revolute(rf.RigidFace("hole"), "ground", name="axle")
    scene = rf.Scene(washer(), SOFT, [hinge])
    *_, report = rf.simulate(scene, 0.01, 0.01)
    rf.write_bodies(tmp_path / "bodies.json", scene, report)
    (read,) = rf.read_joints(tmp_path / "bodies.json")
    placed = scene.named(rf.Revolute)[0]
    assert read == placed
    assert read.at == pytest.approx((0.3, 0.02, 0.1))
    assert rf.read_bodies(tmp_path / "bodies.json", scene.domain)[1] == ()
    (tmp_path / "bodies.json").write_text("{}")
    with pytest.raises(rf.SceneError, match=r"read_joints: .* cannot be read"):
        rf.read_joints(tmp_path / "bodies.json")


@NO_WARNINGS
def test_flat_faces_of_meshes_that_do_not_match_are_tied():
    """Patch test: a block in two meshes under a uniform pull strains as one, in a moving frame."""
    seam = 1 + 2e-7  # m: places tell the two meshes apart
    domain = boxes(((0, 0, 0), (1, 1, 1), (2, 2, 2)), ((seam, 0, 0), (2, 1, 1), (3, 3, 3)))
    domain = domain.with_facets("left", lambda x: np.isclose(x[0], 0))
    domain = domain.with_facets("right", lambda x: np.isclose(x[0], 2))
    domain = domain.with_facets("a", lambda x: np.abs(x[0] - 1) < 1e-8)
    domain = domain.with_facets("b", lambda x: np.abs(x[0] - seam) < 1e-8)
    pull = 1e4
    loads = [rf.Traction("left", (-pull, 0, 0)), rf.Traction("right", (pull, 0, 0))]
    tie = rf.Tied(rf.MeanFace("a"), rf.MeanFace("b"), (1 + 1e-7, 0.5, 0.5), name="tie")
    damped = rf.MassDamping(20.0), rf.NumericalDamping(0.3)
    scene = rf.Scene(domain, SOFT, [tie, *loads, *damped])
    *_, last = rf.simulate(scene, 0.02, 3.0)
    u = last.state.u.x.array.reshape(-1, 3)
    X = last.state.X
    slope = np.polyfit(X[:, 0], u[:, 0], 1)[0]
    green = slope + 0.5 * slope**2
    assert green * (1 + slope) == pytest.approx(pull / SOFT.E, rel=1e-4)
    assert np.abs(u[:, 0] - np.polyval(np.polyfit(X[:, 0], u[:, 0], 1), X[:, 0])).max() < 1e-6
    assert last.joints["tie"].force[0] == pytest.approx(-pull, rel=1e-3)


def washer():
    """A ring of 16 cells round an axis along y through (0.3, ·, 0.1), with a hole of 0.05 m."""
    angle, r, y = np.linspace(0, 2 * np.pi, 17)[:-1], (0.05, 0.1), (0.0, 0.04)
    points = [(0.3 + s * np.cos(a), h, 0.1 + s * np.sin(a)) for a in angle for s in r for h in y]
    corner = np.array([0, 1, 2, 3])
    cells = [np.r_[4 * k + corner, 4 * ((k + 1) % 16) + corner] for k in range(16)]
    domain = rf.from_arrays(np.array(points), np.array(cells))
    domain = domain.with_facets("hole", lambda x: np.hypot(x[0] - 0.3, x[2] - 0.1) < 0.051)
    return domain.with_facets("side", lambda x: np.isclose(x[1], 0.0))


def test_a_hole_tells_place_and_axis():
    """To rounding, and the description shows them."""
    hinge = rf.Revolute("ground", rf.MeanFace("hole"), name="axle")
    scene = rf.Scene(washer(), SOFT, [hinge])
    placed = scene.named(rf.Revolute)[0]
    assert placed.at == pytest.approx((0.3, 0.02, 0.1), abs=1e-12)
    assert placed.axis == pytest.approx((0, 1, 0), abs=1e-12)
    assert "at (0.3, 0.02, 0.1)" in str(scene.describe())
    flat = rf.Revolute("ground", rf.MeanFace("side"), name="axle")
    with pytest.raises(rf.SceneError, match=r"axle'?: the surface 'side' is no cylinder"):
        rf.Scene(scene.domain, SOFT, [flat])
    with pytest.raises(rf.SceneError, match="give its at and axis; only a MeanFace"):
        bar(rf.Revolute("ground", "bar"))


def hung(*effects, **options):
    """The first of two bars is held at its end, and the second hangs on both."""
    scene = bars(joined=False)
    domain = scene.domain.with_facets("left", lambda x: np.isclose(x[0], 0.0))
    domain = domain.with_facets("right", lambda x: np.isclose(x[0], 2.02))
    hinge = rf.Revolute(rf.MeanFace("a"), rf.MeanFace("b"), PIN, (0, 0, 1), name="hinge")
    given = [hinge, rf.Fixed("left"), rf.Gravity((0, -1.0, 0)), *effects]
    return rf.Scene(domain, SOFT, given, probes={"end": (2.02, 0.1, 0.1)}, **options)


END = rf.Spherical("ground", rf.MeanFace("right"), (2.02, 0.1, 0.1), name="end")


def frame():
    """A U of bricks whose arms end in two faces."""
    domain = boxes(((0, 0, 0), (1, 0.2, 0.2), (5, 1, 1)))
    return domain.with_facets("l", lambda x: x[0] < 0.2 + 1e-6).with_facets(
        "r", lambda x: x[0] > 0.8 - 1e-6
    )


@NO_WARNINGS
def test_a_joint_whose_sides_become_one_body_has_no_force():
    """A motor there is refused by name."""
    middle = 0.5, 0.1, 0.1
    spin = rf.InitialVelocity(angular=(0, 0, 1.0), centre=middle)
    sides = rf.MeanFace("l"), rf.MeanFace("r")
    criterion = rf.StrainRate(1e9, 0.1, patience=1, wake="none")
    scene = rf.Scene(frame(), SOFT, [rf.Spherical(*sides, middle), spin])
    with pytest.warns(rf.RigidfxWarning, match="3 of the rows of joints follow from others"):
        reports = list(rf.simulate(scene, 0.01, 0.2, rigidify=criterion))
    assert reports[-1].unknowns == 6
    energies = np.array([report.energy for report in reports])
    assert np.abs(energies - energies[0]).max() <= 1e-12 * energies[0]
    slide = rf.Prismatic(*sides, middle, (1, 0, 0), name="slide")
    lock = rf.Motor("slide", rate=0.0)
    locked = rf.Scene(frame(), SOFT, [slide, lock, spin])
    with pytest.raises(rf.StepError, match="prescribes a motion of 'slide', which cannot move"):
        list(rf.simulate(locked, 0.01, 0.2, rigidify=criterion))


@pytest.mark.filterwarnings("ignore:5 of the rows")  # before anything moves
def test_a_joint_that_a_support_pulls_open_is_told():
    moved = rf.PrescribedMotion("x0", displacement=lambda t: (0.2 * t * t, 0, 0))
    domain = bar().domain
    scene = rf.Scene(domain, SOFT, [rf.Rigid("bar"), HINGE, moved])
    with pytest.raises(rf.StepError, match=r"A joint is pulled open, by .* joint: x"):
        list(rf.simulate(scene, 0.01, 0.1))


def test_statics_are_where_a_damped_motion_comes_to_rest():
    """The second bar is held by joints alone; forces of joints and supports carry the weight."""
    *_, last = rf.static(hung(END), 2)
    *_, rest = rf.simulate(hung(END, rf.MassDamping(8.0)), 0.05, 5.0)
    off = np.abs(last.state.u.x.array - rest.state.u.x.array).max()
    assert off <= 2e-3 * np.abs(last.state.u.x.array).max()
    weight = SOFT.rho * 2 * 0.04
    assert last.reactions["left"][1] - last.joints["end"].force[1] * -1 == pytest.approx(weight)
    assert last.joints["hinge"].gap <= 1e-13
    assert abs(last.joints["hinge"].moment[2]) <= 1e-9 * weight


@NO_WARNINGS
def test_a_run_from_a_static_report_goes_on_counting_turns():
    """The joints of both scenes are other objects of the same name."""
    turning = rf.Motor("joint", angle=lambda t: 8.0 * t)
    first = bar(HINGE, turning)
    *_, turned = rf.static(first, steps=20)
    assert turned.joints["joint"].angle == pytest.approx(8.0, abs=1e-12)
    then = rf.Scene(first.domain, SOFT, [*first.named(rf.Rigid), HINGE])
    *_, last = rf.simulate(then, 0.01, 0.02, start=turned)
    assert last.joints["joint"].angle == pytest.approx(8.0, abs=1e-9)


def test_springs_and_locks_of_joints_hold_in_statics():
    """Work of the weight is the energy that is stored; an angle is given by load steps."""
    reports = list(rf.static(hung(rf.JointSpring("hinge", 5000.0)), 2))
    told = reports[-1].joints["hinge"]
    effort = told.efforts["JointSpring of 'hinge'"]
    assert effort == pytest.approx(-5000.0 * told.angle, rel=1e-9)
    assert told.moment[2] == pytest.approx(effort, rel=1e-3)  # the faces are strained
    *_, turned = rf.static(hung(rf.Motor("hinge", angle=lambda t: -0.3 * t)), 2)
    assert turned.joints["hinge"].angle == pytest.approx(-0.3, abs=1e-12)
    *_, hangs = rf.static(hung(), 1)  # its weight alone holds it
    assert abs(hangs.joints["hinge"].moment[2]) < 1e-6 * reports[-1].joints["hinge"].moment[2] ** 2


@NO_WARNINGS
def test_a_preload_bends_what_joints_hold():
    """The run starts in equilibrium, and stays there."""
    weight = rf.Preload([rf.Gravity((0, -1.0, 0))])
    reports = list(rf.simulate(hung(END, weight), 0.02, 0.2))
    assert reports[0].strain > 0.1
    assert max(r.kinetic for r in reports) <= 1e-12 * reports[0].energy


@NO_WARNINGS
def test_modes_of_two_bars_on_a_hinge_are_those_of_one_bar():
    """A locked hinge makes both one cantilever; a free one has a motion without energy."""
    locked = rf.modes(hung(rf.Motor("hinge", speed=0.0)), 2)
    assert locked.squares[0] == pytest.approx(locked.squares[1], rel=1e-7)  # of a square section
    loose = rf.modes(hung(), 1)
    assert loose.rigid == 1
    assert loose.squares[0] == pytest.approx(locked.squares[0], rel=1e-7)  # across the hinge
    sprung = [rf.modes(hung(rf.JointSpring("hinge", k)), 1).squares[0] for k in (1e-2, 2e-2)]
    assert sprung[1] / sprung[0] == pytest.approx(2, rel=1e-3)  # a soft spring and a rigid bar


def history(mass):
    """Numbers of a run with one bar rigid, and one with both flexible."""
    rows = []
    for effects, sides in (PARTS["flexible"], PARTS["one rigid"]):
        scene = bars(*effects, sides=sides, mass=mass, probes={"tip": (2.02, 0.2, 0.2)})
        for r in rf.simulate(scene, 0.01, 0.08):
            rows.append([r.energy, r.kinetic, *r.angular_momentum, *r.probes["tip"]])
    sides = rf.RigidFace("a"), rf.RigidFace("b")
    scene = bars(sides=sides, mass=mass, probes={"tip": (2.02, 0.2, 0.2)})
    for r in rf.simulate(scene, 0.01, 0.05):
        rows.append([r.energy, r.kinetic, *r.angular_momentum, *r.probes["tip"]])
    end = scene.domain.with_facets("end", lambda x: x[0] < 1e-6)  # some ranks have none of it
    with pytest.raises(rf.SceneError, match="the surface 'end' is no cylinder"):
        rf.Scene(end, SOFT, [rf.Revolute("ground", rf.MeanFace("end"))])
    *_, last = rf.static(hung(END), 1)
    force = last.joints["end"].force
    rows.append([last.energy, last.strain, *force, *last.probes["end"]])
    rows.append([*rf.modes(hung(rf.JointSpring("hinge", 500.0)), 4).squares[:4], 0, 0, 0, 0])
    title = "Revolute MeanFace 'a' - MeanFace 'b'"
    driven = rf.JointSpring(title, 50.0, damping=1.0), rf.Motor(title, torque=lambda t: 20 * t)
    far = rf.MeanFace("b")
    driven += rf.Spring(far, 500.0, at=(1.5, 0.3, 0.1)), rf.Resultant(far, torque=(0.0, 1.0, 2.0))
    driven += rf.PointMass(far, 3.0, at=(1.4, 0.3, 0.1)), rf.Resultant(far, force=(5.0, 0.0, 0.0))
    scene = bars(*driven, mass=mass, probes={"tip": (2.02, 0.2, 0.2)})
    resolved = bars(*driven, rf.ResolvedForces(), mass=mass, probes={"tip": (2.02, 0.2, 0.2)})
    for r in list(rf.simulate(resolved, 0.01, 0.03))[1:]:
        told = r.joints[title]
        rows.append([r.energy, told.angle, *told.force, *r.probes["tip"]])
    release = rf.Release(at=(0.1,))
    criterion = rf.StrainRate(1e9, 0.05, patience=1, wake="none", release=release)
    for r in rf.simulate(scene, 0.01, 0.15, rigidify=criterion):
        told = r.joints[title] if r.joints else None
        angle, force = (told.angle, told.force[0]) if told else (0.0, 0.0)
        rows.append([r.energy, angle, force, *r.angular_momentum[:2], *r.probes["tip"]])
    return rows


@NO_WARNINGS
@pytest.mark.parallel
@pytest.mark.parametrize(("ranks", "mass"), [(3, "consistent")])
def test_ranks_find_the_same(ranks, mass):
    """Sides of a joint may be on different ranks."""
    parallel.check_the_same(__file__, ranks, history(mass), mass)


if __name__ == "__main__":
    import sys
    import warnings

    warnings.simplefilter("ignore")
    parallel.report(history(sys.argv[1]))


def test_a_motor_that_throws_a_rigid_body_is_told_without_a_node():
    """30 degrees given as radians; no node has a residual, and the message named one at NaN."""
    with (
        pytest.warns(rf.RigidfxWarning, match="with angle 30 rad.* it is thrown there"),
        pytest.raises(rf.StepError, match="look at loads, motors, supports") as error,
    ):
        list(rf.simulate(bar(HINGE, rf.Motor("joint", angle=30.0)), 1e-3, 2e-3))
    assert "nan" not in str(error.value)

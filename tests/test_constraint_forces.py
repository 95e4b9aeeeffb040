"""Forces of motors, joints and supports have no vibration that Δt does not resolve."""

from itertools import pairwise

import numpy as np
import pytest
from common import boxes
from histories import heard

import rigidfx as rf
from rigidfx.report.resolved_forces import resolved_part

STEEL = rf.StVenantKirchhoff(rho=7800.0, E=2.1e11, nu=0.3)
PIN = rf.Revolute("ground", "disc", at=(0, 0, 0), axis=(0, 0, 1), name="pin")
SPIN = 60.0  # rad/s
DT = 1e-3  # s
ABOUT_AXIS = 7800.0 * 0.4 * 0.4 * 0.04 * (0.4**2 + 0.4**2) / 12  # kg m², of the plate
RINGING = ABOUT_AXIS * SPIN**3 * DT / 6  # N m, that alternates without a correction


def _plate(*effects, **options):
    """A plate that spins about z, one body."""
    domain = rf.box((-0.2, -0.2, -0.02), (0.2, 0.2, 0.02), (2, 2, 1))
    domain = domain.with_cells("disc", lambda x: x[0] < 1.0)
    turning = rf.InitialVelocity(angular=(0, 0, SPIN))
    return rf.Scene(domain, STEEL, [rf.Rigid("disc"), turning, *effects], **options)


def _steps(scene, dt, steps):
    """Reports of the steps."""
    return list(rf.simulate(scene, dt, steps * dt))[1:]


@pytest.mark.parametrize("given", [{"speed": SPIN}, {"angle": lambda t: SPIN * t}])
def test_a_motor_that_turns_steadily_has_no_torque(given):
    """It had ± RINGING, with the mean zero; the work stays that of the multiplier."""
    reports = _steps(_plate(PIN, rf.Motor("pin", **given)), DT, 6)
    torques = [r.joints["pin"].efforts["Motor of 'pin'"] for r in reports]
    moments = [r.joints["pin"].moment[2] for r in reports]
    assert np.abs([*torques, *moments]).max() <= 2e-3 * RINGING
    gained = reports[-1].energy - 0.5 * reports[0].energy - 0.5 * reports[1].energy
    assert abs(gained) < 1e-2 * reports[0].energy


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("whole", [True, False])
def test_a_support_that_turns_steadily_has_no_moment(mass, whole):
    """It had ± RINGING where all of a part follows the support; books are exact by `impulse`."""
    turned = rf.PrescribedRotation("disc", axis=(0, 0, 1), angle=lambda t: SPIN * t)
    scene = _plate(turned, mass=mass)
    if not whole:  # flexible cells, whose nodes the support holds
        effects = [effect for effect in scene.effects if not isinstance(effect, rf.Rigid)]
        scene = rf.Scene(scene.domain, STEEL, effects, mass=mass)
    reports = _steps(scene, DT, 6)
    assert max(abs(r.reaction_moments["disc"][2]) for r in reports) <= 2e-3 * RINGING
    for before, after in pairwise(reports):
        held = DT * after.reaction_moments["disc"] + after.angular_impulse
        gained = after.angular_momentum - before.angular_momentum
        assert gained == pytest.approx(held, abs=1e-9 * np.abs(before.angular_momentum).max())


def _pendulum(*effects):
    """Two rigid links that hang from hinges."""
    domain = boxes(
        ((0, 0, 0), (0.5, 0.05, 0.05), (1, 1, 1)), ((0.52, 0, 0), (1.02, 0.05, 0.05), 3 * (1,))
    )
    domain = domain.with_cells("a", lambda x: x[0] < 0.51).with_cells("b", lambda x: x[0] > 0.51)
    hinges = [
        rf.Revolute("ground", "a", at=(-0.01, 0.025, 0.025), axis=(0, 0, 1), name="upper"),
        rf.Revolute("a", "b", at=(0.51, 0.025, 0.025), axis=(0, 0, 1), name="lower"),
    ]
    parts = rf.Rigid("a"), rf.Rigid("b"), rf.Gravity((0, -9.81, 0))
    return rf.Scene(domain, STEEL, [*parts, *hinges, *effects])


@pytest.mark.parametrize(
    "motor",
    [
        (),
        (rf.Motor("upper", angle=lambda t: 0.5 - 0.5 * np.cos(9 * t)),),
        (rf.Motor("upper", speed=lambda t: 4 * np.sin(5 * t)),),
    ],
)
def test_forces_of_a_mechanism_converge_with_second_order(motor):
    """From the first step on, without a smooth start: forces jump there."""
    found = []
    for n in (1, 3, 9):
        reports = _steps(_pendulum(*motor), 0.02 / n, 10 * n)[n // 2 :: n]  # of the same middles
        joints = [(r.joints["upper"], r.joints["lower"]) for r in reports]
        efforts = [list(upper.efforts.values())[:1] for upper, _ in joints]
        found.append(np.hstack([[[*a.force, *b.force] for a, b in joints], efforts]))
    off = [np.abs(own - found[-1]).max() for own in found[:2]]
    assert off[1] <= off[0] / 7  # 10 of order 2 against a third as long a step
    assert off[1] <= 2e-3 * np.abs(found[-1]).max()


@pytest.mark.parametrize("rigid", [True, False])
def test_a_chain_at_rest_bears_its_weight_in_each_step(rigid):
    """After a swing; velocities across rows, and vibration of links, went on to alternate."""
    cells = (1, 2, 1)
    domain = boxes(((0, 0.52, 0), (0.05, 1.02, 0.05), cells), ((0, 0, 0), (0.05, 0.5, 0.05), cells))
    domain = domain.with_cells("a", lambda x: x[1] > 0.51).with_cells("b", lambda x: x[1] < 0.51)
    for name, y in (("top", 1.02), ("bottom", 0.52), ("below", 0.5)):
        domain = domain.with_facets(name, lambda x, y=y: np.isclose(x[1], y))
    faces = [rf.MeanFace(name) for name in ("top", "bottom", "below")]
    top, bottom, below = ("a", "a", "b") if rigid else faces
    ends = ("ground", top, "upper", 1.03), (bottom, below, "lower", 0.51)
    hinges = [
        rf.Revolute(one, other, at=(0.025, y, 0.025), axis=(0, 0, 1), name=name)
        for one, other, name, y in ends
    ]
    dampers = [rf.JointSpring(name, damping=40.0) for name in ("upper", "lower")]
    swing = rf.InitialVelocity(angular=(0, 0, 2.0), centre=(0.025, 1.03, 0.025))
    parts = (rf.Rigid("a"), rf.Rigid("b")) if rigid else ()
    effects = [*parts, rf.Gravity((0, -9.81, 0)), *hinges, *dampers, swing]
    effects += [] if rigid else [rf.ResolvedForces()]
    reports = _steps(rf.Scene(domain, STEEL, effects), 0.02, 80)
    weight = 7800.0 * 0.5 * 0.05**2 * 9.81
    for r in reports[-3:]:
        assert r.joints["upper"].force[1] == pytest.approx(2 * weight, rel=5e-4)
        assert r.joints["lower"].force[1] == pytest.approx(weight, rel=5e-4)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_flexible_plate_turned_at_its_hub_has_no_moment(mass):
    """Its rim starts as a rigid body and vibrates too fast for Δt; books are exact by `impulse`."""
    domain = rf.box((-0.05, -0.05, -0.01), (0.05, 0.05, 0.01), (4, 4, 1))
    domain = domain.with_vertices("hub", lambda x: np.hypot(x[0], x[1]) < 0.03)
    turned = rf.PrescribedRotation("hub", axis=(0, 0, 1), angle=lambda t: SPIN * t)
    effects = turned, rf.InitialVelocity(angular=(0, 0, SPIN)), rf.ResolvedForces()
    reports = list(rf.simulate(rf.Scene(domain, STEEL, effects, mass=mass), DT, 20 * DT))
    ringing = 7800.0 * 0.1 * 0.1 * 0.02 * (0.1**2 + 0.1**2) / 12 * SPIN**3 * DT / 6
    momenta = [r.angular_momentum[2] for r in reports]
    assert np.abs(np.diff(momenta)).max() > 0.5 * ringing * DT  # in the motion it is still there
    for before, after in pairwise(reports):
        moment = after.reaction_moments["hub"][2]
        assert abs(moment) <= 1.5e-2 * ringing
        gained = after.angular_momentum[2] - before.angular_momentum[2]
        held = DT * moment + after.angular_impulse[2]
        assert gained == pytest.approx(held, abs=1e-9 * momenta[0])


def test_a_motor_on_a_flexible_plate_has_the_torque_of_its_inertia():
    """A smooth start; a rotor of 20 mm on a mean face, 5 % off without a correction."""
    domain = rf.box((-0.05, -0.05, -0.01), (0.05, 0.05, 0.01), (4, 4, 1))
    domain = domain.with_facets("hub", lambda x: (x[2] < -0.009) & (np.hypot(x[0], x[1]) < 0.04))
    pin = rf.Revolute("ground", rf.MeanFace("hub"), at=(0, 0, 0), axis=(0, 0, 1), name="pin")
    motor = rf.Motor("pin", angle=lambda t: SPIN * t**3 / DT**2 / 1e3)
    scene = rf.Scene(domain, STEEL, [pin, motor, rf.ResolvedForces()], mass="consistent")
    reports = _steps(scene, DT, 10)
    inertia = 7800.0 * 0.1 * 0.1 * 0.02 * (0.1**2 + 0.1**2) / 12
    last = 6 * SPIN * 1e-2 / DT
    exact = inertia * last * (np.arange(10) + 0.5) / 10
    torques = [r.joints["pin"].efforts["Motor of 'pin'"] for r in reports]
    assert torques == pytest.approx(exact, abs=5e-3 * inertia * last)


@pytest.mark.parametrize(("steps", "kept"), [(10, 0.992), (13, 0.997)])
def test_vibration_that_steps_resolve_stays_in_reactions(steps, kept):
    """A bar whose support accelerates at once: the stated amplitude of its first period."""
    domain = rf.box((0, 0, 0), (1, 0.1, 0.1), (12, 1, 1))
    steel = rf.StVenantKirchhoff(rho=7800.0, E=2.1e11, nu=0.0)
    moved = rf.PrescribedMotion("x0", displacement=lambda t: (50 * t**2, 0, 0))
    period = 4 / np.sqrt(2.1e11 / 7800.0)
    scene = rf.Scene(domain, steel, [moved, rf.ResolvedForces()])
    reports = list(rf.simulate(scene, period / steps, 6 * period))
    momenta = [r.linear_momentum[0] for r in reports]
    told = [r.reactions["x0"][0] for r in reports[1:]]
    wave = np.exp(-2j * np.pi * np.arange(len(told)) / steps)
    amplitude, raw = abs(told @ wave), abs(np.diff(momenta) @ wave) * steps / period
    assert amplitude / raw == pytest.approx(kept, abs=1e-3)
    assert np.mean(told) * 6 * period == pytest.approx(momenta[-1], rel=2e-2)


def test_a_polygon_of_a_path_accelerates_in_the_steps_after_its_corners():
    """Its corners are at ends of steps, so that no second difference within a step has them."""
    corners = DT * np.arange(12)
    angles = SPIN * corners + 50.0 * corners * (corners - DT)
    path = rf.Motor("pin", angle=lambda t: np.interp(t, corners, angles))
    reports = _steps(_plate(PIN, path, mass="consistent"), DT, 10)
    torques = [r.joints["pin"].efforts["Motor of 'pin'"] for r in reports[1:]]
    assert torques == pytest.approx(np.full(9, 100.0 * ABOUT_AXIS), rel=5e-3)


def test_a_window_and_a_blow_smear_nothing():
    """The torque of a window's last step and of the next one are those of their own time."""
    pushed = rf.Motor("pin", angle=lambda t: 50.0 * t**2 + SPIN * t, until=5 * DT)
    reports = _steps(_plate(PIN, pushed, mass="consistent"), DT, 8)
    torques = [r.joints["pin"].efforts.get("Motor of 'pin'", 0.0) for r in reports]
    assert torques[:5] == pytest.approx(np.full(5, 100.0 * ABOUT_AXIS), rel=2e-2)
    assert np.abs(torques[5:]).max() == 0.0
    moments = [r.joints["pin"].moment[2] for r in reports]
    assert moments == pytest.approx(torques, abs=2e-3 * max(torques))


@pytest.mark.filterwarnings("ignore:.*goes back and forth")
def test_columns_without_unresolved_vibration_are_as_with_the_effect(tmp_path):
    """At no cost: a plate turned at its hub has no moment; written ones alternate by RINGING."""
    domain = rf.box((-0.05, -0.05, -0.01), (0.05, 0.05, 0.01), (4, 4, 1))
    domain = domain.with_vertices("hub", lambda x: np.hypot(x[0], x[1]) < 0.03)
    turned = rf.PrescribedRotation("hub", axis=(0, 0, 1), angle=lambda t: SPIN * t)
    scene = rf.Scene(domain, STEEL, [turned, rf.InitialVelocity(angular=(0, 0, SPIN))])
    with rf.Recorder(scene, tmp_path, stress=False) as recorder:
        for report in rf.simulate(scene, DT, 20 * DT):
            recorder.write(report)
    h, name = rf.read_history(tmp_path), "moment_hub_z"
    assert np.abs(h[f"{name}_resolved"]).max() <= 1e-2 * np.abs(h[name]).max()


def test_a_series_keeps_vibration_that_steps_resolve_and_jumps():
    """1 - sin⁴(θ/2) of a vibration, and all of a jump of a smooth force; ends are off by little."""
    k = np.arange(60)
    smooth = 5 + 0.1 * k - 0.002 * k**2
    jump, ten = smooth + 3 * (k > 30), np.cos(2 * np.pi * k / 10 + 0.3)
    fast, θ = np.cos(2 * np.arctan(10.0) * k + 0.3), 2 * np.arctan(10.0)
    found = resolved_part(np.stack([smooth + (-1.0) ** k, jump, ten, fast], axis=1))
    expected = np.stack([smooth, jump, ten, (1 - np.sin(θ / 2) ** 4) * fast], axis=1)
    assert found[2:-2] == pytest.approx(expected[2:-2], abs=1e-12)
    assert np.abs(found - expected)[:, :3].max() <= 5e-3


@pytest.mark.parametrize(
    ("at", "words"),
    [
        ("motor", ["Motor of 'pin' goes back and forth", "(likewise force of Revolute 'pin'"]),
        ("support", ["moment of 'hub' goes back and forth", "by 0.0874 N m: its peak is 0.096"]),
        ("resolved", []),
        ("smooth", []),
    ],
)
def test_forces_that_alternate_are_told_by_name(at, words):
    """With their peak, that of means, and the remedy; smooth and resolved ones are not told."""
    domain = rf.box((-0.05, -0.05, -0.01), (0.05, 0.05, 0.01), (4, 4, 1))
    domain = domain.with_vertices("hub", lambda x: np.hypot(x[0], x[1]) < 0.03)
    domain = domain.with_facets("seat", lambda x: (x[2] < -0.009) & (np.hypot(x[0], x[1]) < 0.04))
    turned = rf.PrescribedRotation("hub", axis=(0, 0, 1), angle=lambda t: SPIN * t)
    pin = rf.Revolute("ground", rf.MeanFace("seat"), at=(0, 0, 0), axis=(0, 0, 1), name="pin")
    spun = rf.InitialVelocity(angular=(0, 0, SPIN))
    smooth = rf.Motor("pin", speed=lambda t: SPIN * np.sin(5 * t) ** 2)
    effects = {
        "motor": [pin, rf.Motor("pin", speed=SPIN), spun],
        "support": [turned, spun],
        "resolved": [turned, spun, rf.ResolvedForces()],
        "smooth": [pin, smooth],
    }
    scene = rf.Scene(domain, STEEL, effects[at])
    with heard("back and forth") as told:
        _steps(scene, DT, 20)
    assert len(told) == bool(words)
    assert all(word in told[0] for word in [*words, "rf.ResolvedForces()"] if words)

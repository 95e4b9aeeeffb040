"""Effects that say where they act mean the body where it lies at the start of a run."""

import numpy as np
import pytest

import rigidfx as rf
from rigidfx.mechanics.rotation import cayley

# Bars of one cell across are stiff in bending; two that touch are meant to be apart.
pytestmark = [
    pytest.mark.filterwarnings("ignore:Scene. the part of:rigidfx.RigidfxWarning"),
    # One that a rotation from rest takes along at once.
    pytest.mark.filterwarnings("ignore:.* acts with a jolt:rigidfx.RigidfxWarning"),
]

MATERIAL = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=10.0)
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # about z
SKEWED = cayley(np.array([0.3, -0.8, 1.1]))


def bar():
    return rf.box((0, 0, 0), (2, 0.5, 0.5), (4, 1, 1)).with_cells(
        "tip", lambda x: x[0] > 1.5 - 1e-9
    )


def placed(R, shift=(0.0, 0.0, 0.0)):
    """A displacement that turns a body by R about the origin, and shifts it."""
    far = np.asarray(shift)[:, None]
    return rf.InitialDisplacement(lambda x: R @ x + far - x)


def run(effects, steps=6, dt=0.02, **options):
    scene = rf.Scene(bar(), MATERIAL, effects, probes={"end": (2.0, 0.5, 0.25)}, **options)
    return list(rf.simulate(scene, dt, steps * dt, progress=False))


def place(report):
    return np.array([2.0, 0.5, 0.25]) + report.probes["end"]


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("R", [np.eye(3), QUARTER, QUARTER @ QUARTER, SKEWED])
def test_a_body_spins_about_its_centre_where_it_lies(R, mass):
    """It has the spin of a body that was meshed there, and no momentum."""
    omega = np.array([0.2, -0.3, 1.0])
    reference = run([rf.InitialVelocity(angular=R.T @ omega)], 1, mass=mass)[0]
    spin = rf.InitialVelocity(angular=omega)
    first = run([placed(R, (5.0, -3.0, 1.0)), spin], 1, mass=mass)[0]
    np.testing.assert_allclose(first.linear_momentum, 0.0, atol=1e-12)
    expected = R @ reference.angular_momentum
    np.testing.assert_allclose(first.angular_momentum, expected, atol=1e-12)
    assert first.strain < 1e-12 * first.kinetic


def support_of(axis):
    return rf.PrescribedRotation(
        "x0", axis=axis, angle=lambda t: 2.0 * t, speed=lambda t: 2.0, since=0.0
    )


SPUN = rf.InitialVelocity(angular=(0.0, 0.0, 2.0), centre=(0.0, 0.0, 0.0))
OWN_FIELD = rf.InitialVelocity(function=lambda x: np.cross((0, 0, 2.0), (QUARTER @ x).T).T)
SCENES = {
    "rotation": ([SPUN, support_of((0, 0, 1))], [SPUN, support_of((0, 0, 1))]),
    "velocity by a function": ([SPUN, support_of((0, 0, 1))], [OWN_FIELD, support_of((0, 0, 1))]),
    "rotation from rest": ([support_of((0, 0, 1))], [support_of((0, 0, 1))]),
    "a rigid tip on a rotation": (
        [rf.Rigid("tip"), SPUN, support_of((0, 0, 1))],
        None,  # rigid parts are not displaced
    ),
    "symmetry": (
        [rf.Symmetry("x0"), rf.Symmetry("y0"), rf.Traction("x1", (50.0, 0.0, 0.0))],
        [rf.Symmetry("x0"), rf.Symmetry("y0"), rf.Traction("x1", (0.0, 50.0, 0.0))],
    ),
    "springs": (
        [rf.Spring("x0", (4e3, 1e3, 2e3)), rf.Traction("x1", (50.0, 0.0, 20.0))],
        [rf.Spring("x0", (1e3, 4e3, 2e3), relaxed="start"), rf.Traction("x1", (0.0, 50.0, 20.0))],
    ),
}


@pytest.mark.parametrize("name", [name for name, (_, turned) in SCENES.items() if turned])
def test_a_turned_body_moves_as_the_other_one_turned(name):
    """The same history, rotated by a quarter turn."""
    meshed, turned = SCENES[name]
    expected, found = run(meshed), run([placed(QUARTER), *turned])
    for a, b in zip(expected, found, strict=True):
        np.testing.assert_allclose(place(b), QUARTER @ place(a), atol=1e-9)
        assert b.energy == pytest.approx(a.energy, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("rigid", [False, True])
def test_a_rotation_that_begins_later_takes_nodes_along_where_they_are(rigid):
    """A body that spins already goes on spinning: no impact, no work, energy as before."""
    turning = rf.PrescribedRotation(
        "x0", axis=(0, 0, 2), through=(1.0, 0.25, 0.0), angle=lambda t: 1.5 * t, since=0.1
    )
    spin = rf.InitialVelocity(angular=(0.0, 0.0, 1.5))
    named = [rf.Rigid()] if rigid else []
    reports = run([spin, turning, *named], steps=8, dt=0.025)
    impact = sum(abs(r.impact.energy) for r in reports if r.impact)
    assert impact < 1e-3 * reports[0].kinetic
    assert max(r.strain for r in reports) < 1e-2 * reports[0].kinetic


def rotor(omega, *effects, **how):
    """A bar of 0.5 m that spins about one end."""
    steel = rf.StVenantKirchhoff(E=2e11, nu=0.0, rho=7800.0)
    bar = rf.box((0, -0.005, -0.005), (0.5, 0.005, 0.005), (10, 1, 1))
    spun = rf.Preload(spin=(0.0, 0.0, omega), increments=3)
    probes = {"tip": (0.5, 0.0, 0.0)}
    return rf.Scene(bar, steel, [*effects, spun], order=2, probes=probes, **how)


@pytest.mark.parametrize("at", [None, (1.3, 0, 0), (1.3, 0.1, 0.05)])
@pytest.mark.parametrize("face", [rf.MeanFace("x1"), rf.RigidFace("x1")])
def test_a_rotor_starts_in_equilibrium_with_a_mass_at_its_end(face, at):
    """No swing, and the hub holds the centripetal forces of all mass, as far as it bends."""
    omega, bar = 20.0, rf.box((0.1, -0.05, -0.05), (1.1, 0.05, 0.05), (5, 1, 1))
    hub = rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=lambda t: omega * t)
    mass, spun = rf.PointMass(face, 5.0, at=at), rf.Preload(spin=(0, 0, omega))
    rubber = rf.StVenantKirchhoff(E=1e8, nu=0.0, rho=1000.0)
    tip = {"tip": (1.1, 0, 0)}
    scene = rf.Scene(bar, rubber, [hub, mass, spun], element="enhanced", probes=tip)
    first, *reports = rf.simulate(scene, 1e-3, 0.02, progress=False)
    ends = [np.linalg.norm(r.probes["tip"] + (1.1, 0, 0)) for r in (first, *reports)]
    assert np.ptp(ends) < 1e-3 * (ends[0] - 1.1)
    forces = [np.linalg.norm(r.reactions["x0"]) for r in reports]
    assert np.ptp(forces) < 1e-3 * forces[0]
    radius = np.linalg.norm((at or (1.1, 0, 0))[:2])
    assert forces[0] == pytest.approx(omega**2 * (10.0 * 0.6 + 5.0 * radius), rel=0.01)


@pytest.mark.parametrize("face", [rf.MeanFace("x1"), rf.RigidFace("x1")])
def test_a_mass_beside_its_face_starts_with_that_after_a_preload(face):
    """It had stood still: 10 and 38 kg m/s."""
    bar = rf.box((0.1, -0.05, -0.05), (1.1, 0.05, 0.05), (5, 1, 1))
    thrown = rf.InitialVelocity(linear=(1, 2, 0), angular=(0, 0, 3), centre=(0, 0, 0))
    mass, hung = rf.PointMass(face, 5.0, at=(1.3, 0.1, 0.05)), rf.Preload([rf.Gravity()])
    rubber = rf.StVenantKirchhoff(E=1e8, nu=0.0, rho=1000.0)
    effects = [rf.Spring("x0", 1e5), rf.Spring("x1", 1e5), hung, thrown, mass]
    first = next(rf.simulate(rf.Scene(bar, rubber, effects, element="enhanced"), 1e-3, 1e-3))
    assert first.linear_momentum == pytest.approx([10 + 3.5, 38 + 29.5, 0], rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize(
    ("omega", "tip"),
    # End of a bar of 0.5 m on a hub, E 2e11 Pa, 7800 kg/m³, ν = 0: (E s/2)(3 s² - 1)' + ρ ω² x = 0
    # of the stretch s by St.Venant and Kirchhoff, solved by a collocation of fourth order.
    [(3000.0, 14.379e-3), (1000.0, 1.62185e-3), (300.0, 0.146224e-3)],
)
def test_a_rotor_starts_in_equilibrium(omega, tip, mass):
    """Its stretch is that of theory, and stays: no swing.

    The hub is led through ω Δt a step, where the method turns a free body by 2 atan(ω Δt/2). That
    leaves a swing of (ω Δt)²/6 at most.
    """
    hub = rf.PrescribedRotation(
        "x0", axis=(0, 0, 1), angle=lambda t: omega * t, speed=lambda t: omega
    )
    scene = rotor(omega, hub, mass=mass)
    reports = rf.simulate(scene, 0.02 / omega, 0.4 / omega, progress=False)
    ends = [np.linalg.norm(r.probes["tip"] + (0.5, 0.0, 0.0)) - 0.5 for r in reports]
    assert ends[0] == pytest.approx(tip, rel=5e-5)
    assert np.ptp(ends) < 1e-4 * tip


def test_a_spin_is_about_the_axis_of_a_hinge():
    """Motors of hinges spin rotors as supports do; two axes are refused."""
    hinge = rf.Revolute("ground", rf.MeanFace("x0"), at=(0, 0, 0), axis=(0, 0, 1), name="hub")
    motor = rf.Motor("hub", speed=1000.0)
    first = next(iter(rf.simulate(rotor(1000.0, hinge, motor), 2e-5, 4e-4)))
    np.testing.assert_allclose(first.probes["tip"], (1.62185e-3, 0, 0), rtol=5e-4, atol=1e-9)
    v = first.probes["tip"][0] + 0.5
    assert first.kinetic == pytest.approx(0.5 * 0.39 * (1000.0 * v) ** 2 / 3, rel=2e-3)
    far = rf.Revolute("ground", rf.MeanFace("x1"), at=(0.5, 0, 0), axis=(0, 0, 1), name="far")
    with pytest.raises(rf.SceneError, match=r"have different axes\. Give the centre"):
        next(iter(rf.simulate(rotor(1000.0, hinge, motor, far), 2e-5, 4e-4)))


def test_springs_may_be_strained_by_a_displacement():
    """Released 0.1 m from the place in which its springs have no force, a block swings."""
    up = rf.InitialDisplacement(lambda x: np.array([0 * x[0], 0 * x[0], 0.1 + 0 * x[0]]))
    at_rest = run([up, rf.Spring("x0", 1e3, relaxed="start")])
    assert at_rest[0].energy < 1e-25
    assert np.abs(at_rest[-1].probes["end"] - (0, 0, 0.1)).max() < 1e-14
    strained = run([up, rf.Spring("x0", 1e3)])
    assert strained[0].springs == pytest.approx(0.5 * 1e3 * 0.1**2, rel=1e-12)
    assert strained[-1].kinetic > 0.1 * strained[0].springs
    with pytest.raises(rf.SceneError, match="Spring: relaxed must be 'start' or 'mesh'"):
        rf.Spring("x0", 1e3, relaxed="now")


# Which body, and its mass ------------------------------------------------------------------------


def two_bars():
    """Two bars that touch in a plane, and share no node."""
    x = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])
    cells = np.array([[0, 4, 2, 6, 1, 5, 3, 7]])
    points = np.vstack([x, x + np.array([1.0, 0.0, 0.0])])
    domain = rf.from_arrays(points, np.vstack([cells, cells + 8]))
    domain = domain.with_cells("a", lambda x: x[0] < 1.0 + 1e-9)
    return domain.with_cells("b", lambda x: x[0] > 1.0 - 1e-9)


@pytest.mark.parametrize("where", ["a", "b"])
def test_a_velocity_of_one_part_of_two_that_touch(where):
    v = rf.InitialVelocity(linear=(1.0, 2.0, 0.0), angular=(0.0, 0.0, 3.0), where=where)
    scene = rf.Scene(two_bars(), MATERIAL, [v])
    first = next(rf.simulate(scene, 0.1, 0.1, progress=False))
    np.testing.assert_allclose(first.linear_momentum, (10.0, 20.0, 0.0), atol=1e-12)
    centre = np.array([0.5 if where == "a" else 1.5, 0.5, 0.5])
    own = first.angular_momentum - np.cross(centre, first.linear_momentum)
    np.testing.assert_allclose(own, (0.0, 0.0, 10.0 * 0.5 * 3.0), atol=1e-12)  # lumped: m/2


def test_a_displacement_of_one_part():
    gap = rf.InitialDisplacement(lambda x: np.array([0.3, 0, 0])[:, None] + 0 * x, where="b")
    probes = {"a": (0.1, 0.5, 0.5), "b": (1.9, 0.5, 0.5)}
    scene = rf.Scene(two_bars(), MATERIAL, [gap], probes=probes)
    first = next(rf.simulate(scene, 0.1, 0.1, progress=False))
    np.testing.assert_allclose(first.probes["a"], 0.0, atol=1e-15)
    np.testing.assert_allclose(first.probes["b"], (0.3, 0.0, 0.0), atol=1e-15)


def test_velocities_of_sets_with_common_nodes_are_refused():
    halves = bar().with_cells("rest", lambda x: x[0] < 1.5 + 1e-9)
    both = [rf.InitialVelocity(linear=(1.0, 0.0, 0.0), where=name) for name in ("tip", "rest")]
    with pytest.raises(rf.SceneError, match="'tip' and 'rest' have nodes in common"):
        rf.Scene(halves, MATERIAL, both)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize(
    ("effects", "weight"),
    [
        ([rf.PointMass("x1", 1000.0)], 1000.0 + 1.25),
        ([rf.PointMass("x1", 1000.0), rf.Rigid("tip")], 1000.0 + 1.25),
        ([rf.Rigid("tip", mass=1000.0)], 1000.0),
        (
            [rf.Rigid("tip", mass=1000.0), rf.PointMass("x1", 10.0)],
            1000.0,
        ),  # given in place of both
    ],
)
def test_gravity_on_a_set_acts_on_all_mass_of_its_nodes(effects, weight, mass):
    """The momentum after a tenth of a second is m g t, to rounding."""
    g = rf.Gravity((0.0, 0.0, -9.81), where="tip")
    last = run([g, *effects], steps=5, dt=0.02, mass=mass)[-1]
    # Of a consistent mass, cells beside a body weigh at the nodes that they share with it.
    assert last.linear_momentum[2] == pytest.approx(-9.81 * 0.1 * weight, rel=1e-3)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("where", [None, "tip"])
@pytest.mark.parametrize(
    "effects",
    [
        [rf.PointMass("x1", 1000.0)],
        [rf.Rigid("tip", mass=7.0)],
        [rf.Rigid("tip", mass=7.0), rf.PointMass("y0", 9.0)],
    ],
)
def test_the_centre_of_a_spin_is_that_of_all_mass(effects, where, mass):
    """Point masses and the given mass of a body count: no momentum."""
    spin = rf.InitialVelocity(angular=(0.2, -0.3, 1.0), where=where)
    first = run([spin, *effects], 1, mass=mass)[0]
    np.testing.assert_allclose(first.linear_momentum, 0.0, atol=1e-12 * first.momentum_scale)


def test_a_mass_at_the_tip_weighs_on_what_holds_it():
    """9.81 kN and the 12.3 N of the cells of the tip, of which 1.2 N used to be left."""
    held = [rf.Fixed("x0"), rf.PointMass("x1", 1000.0)]
    weight = rf.Gravity((9.81, 0.0, 0.0), where="tip")
    *_, last = run([*held, rf.Preload([weight]), weight], steps=3)
    assert last.reactions["x0"][0] == pytest.approx(-9.81 * 1001.25, rel=1e-9)


def test_what_would_weigh_twice_or_not_at_all_is_said():
    halves = bar().with_cells("rest", lambda x: x[0] < 1.5 + 1e-9)
    halves = halves.with_facets("side", lambda x: x[1] < 1e-9)
    mass = rf.PointMass("side", 10.0)
    twice = [rf.Gravity(where="tip"), rf.Gravity(where="rest")]
    with pytest.raises(rf.SceneError, match="Gravity: 'tip' and 'rest' both hold nodes of a Point"):
        rf.Scene(halves, MATERIAL, [mass, *twice])
    with pytest.warns(rf.RigidfxWarning, match="does not act on 10 kg of point masses"):
        rf.Scene(halves, MATERIAL, [mass, rf.BodyForce((0.0, 0.0, -98.1))])
    with pytest.warns(rf.RigidfxWarning, match="does not act on 7 kg of point masses"):
        rf.Scene(halves, MATERIAL, [rf.Rigid("tip", mass=7.0), rf.BodyForce((0.0, 0.0, -98.1))])

"""Rigid bodies and supports."""

import numpy as np
import pytest
from histories import EPS, NEWTON, between
from test_supports import Books

import rigidfx as rf

# Supports that begin on moving bodies: their impacts are the subject.
pytestmark = pytest.mark.filterwarnings("ignore:.* acts with a jolt")

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=500.0, nu=0.3)
MOVING = rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.1, 0.2, 0.3))
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])


def domain():
    """A bar of 6 m × 1 m × 1 m with names for some of its cells and nodes."""

    def corner(x):
        return np.isclose(x[0], 0) & np.isclose(x[1], 0) & np.isclose(x[2], 0)

    return (
        rf.box((0, 0, 0), (6, 1, 1), (6, 1, 1))
        .with_cells("left", between(0, 2))
        .with_cells("next", between(2, 4))
        .with_cells("over", between(1, 3))
        .with_cells("right", between(4, 6))
        .with_vertices("corner", corner)
        .with_vertices("edge", lambda x: np.isclose(x[0], 0) & np.isclose(x[1], 0))
        .with_vertices("line", lambda x: np.isclose(x[2], 0) & np.isclose(x[1], 0) & (x[0] < 2.5))
        .with_vertices("three", lambda x: np.isclose(x[0], 0) & (x[1] + x[2] < 1.5))
    )


def bar(*effects, **options):
    """The bar with its left end rigid."""
    return rf.Scene(domain(), MATERIAL, [rf.Rigid("left"), *effects], **options)


# What is possible ------------------------------------------------------------------------------


def same_motion(a, b, tolerance):
    """Whether two scenes of the same mesh move alike for 20 steps of 0.1 s."""
    for r, s in zip(rf.simulate(a, 0.1, 2.0), rf.simulate(b, 0.1, 2.0), strict=True):
        u, w = r.state.u.x.array, s.state.u.x.array
        assert np.abs(u - w).max() <= tolerance * (1e-3 + np.abs(w).max())
        last = r, s
    return last


def away(X):
    """Velocities that vanish up to x = 2."""
    bump = np.maximum(X[0] - 2, 0.0)
    return np.array([0 * bump, 0.1 * bump, 0.05 * bump])


@MASSES
@pytest.mark.parametrize("where", ["x0", "three", "left"])
def test_clamped_body_is_fixed(mass, where):
    """Held at three nodes or more that are not in line: as if all its nodes were."""
    effects = [rf.InitialVelocity(function=away), rf.Gravity((0.0, 0.0, -0.3))]
    clamped = bar(rf.Fixed(where), *effects, mass=mass)
    plain = rf.Scene(domain(), MATERIAL, [rf.Fixed("left"), *effects], mass=mass)
    r, s = same_motion(clamped, plain, 100 * NEWTON)
    assert r.bodies == ()
    assert r.unknowns == s.unknowns == 3 * 16
    left = clamped.nodes("left", "test")
    assert np.all(r.state.u.x.array.reshape(-1, 3)[left] == 0)
    assert np.abs(r.state.u.x.array).max() > 0.1
    assert np.abs(r.reactions[where] - s.reactions["left"]).max() <= 1e-9
    assert abs(r.energy - s.energy) <= 1e-10 * s.energy


@MASSES
def test_clamped_body_follows_its_motion(mass):
    """A prescribed motion of three of its nodes moves all of it, and the rest by it."""

    def way(t):
        return (0.2 * np.sin(t), 0.1 * (1 - np.cos(2 * t)), 0.05 * t**2)

    def speed(t):
        return (0.2 * np.cos(t), 0.2 * np.sin(2 * t), 0.1 * t)

    clamped, plain = (
        rf.Scene(
            domain(),
            MATERIAL,
            [*rigid, rf.PrescribedMotion(where, displacement=way, velocity=speed)],
            mass=mass,
        )
        for rigid, where in (([rf.Rigid("left")], "three"), ([], "left"))
    )
    r, s = same_motion(clamped, plain, 100 * NEWTON)
    left = clamped.nodes("left", "test")
    assert np.abs(r.state.u.x.array.reshape(-1, 3)[left] - way(2.0)).max() <= 100 * EPS
    assert r.work_of_supports == pytest.approx(s.work_of_supports, rel=1e-8)


def bent(X):
    """Velocities that the rigid end keeps in part."""
    return np.array([0 * X[0], 0.1 * X[0] ** 2, 0.2 * X[0] * X[2]])


@MASSES
@pytest.mark.parametrize(
    "start", [MOVING, rf.InitialVelocity(function=bent)], ids=["rigid", "bent"]
)
def test_clamp_that_begins_and_ends(mass, start):
    """A free body is stopped at 0.5 s and let go at 1 s: impact and balance of every step."""
    scene = bar(rf.Fixed("x0", since=0.5, until=1.0), start, mass=mass)
    books, seen = Books(), set()
    for r in rf.simulate(scene, 0.1, 2.0):
        books.enter(r)
        held = 0.5 < r.t - r.dt / 2 < 1.0
        assert len(r.bodies) == (0 if held else 1)
        if r.step:
            seen.add((held, r.unknowns))
    (impact,) = books.impacts
    assert impact.t == pytest.approx(0.5, abs=1e-12)
    assert impact.energy < 0
    assert seen == {(False, 3 * 16 + 6), (True, 3 * 16)}


def test_free_body_next_to_a_support():
    """A layer of flexible cells between them is enough; reactions are in the books."""
    scene = rf.Scene(
        domain(), MATERIAL, [rf.Rigid("right"), rf.Fixed("x0"), rf.Gravity((0, 0.0, -0.3))]
    )
    reports = list(rf.simulate(scene, 0.1, 3.0))
    assert reports[-1].bodies[0].name == "right"
    H, work = reports[0].energy, 0.0
    for r in reports[1:]:
        work += r.work_of_loads
        assert r.work_of_supports == 0.0
        assert r.energy - H == pytest.approx(work, rel=1e-10)
    assert reports[-1].bodies[0].centre[2] < 0.4


def swung(width, *planes):
    """Places of the tip of a bar that hangs by a rigid face at a ball joint, and its energy."""
    bar = rf.box((0, *(-w for w in width), 0), (3, 0.5, 1), (6, 2 if width[0] else 1, 2))
    soft = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)
    ball = rf.Spherical("ground", rf.RigidFace("x0"), (0, 0, 0.5), name="ball")
    scene = rf.Scene(bar, soft, [rf.Gravity(), ball, *planes], probes={"tip": (3, 0, 0.5)})
    reports = list(rf.simulate(scene, 0.02, 0.2, progress=False))
    return np.array([[*r.probes["tip"], r.energy] for r in reports]), scene


def test_symmetry_cuts_a_rigid_face():
    """Half of a pendulum moves as all of it: its rigid face tilts about the plane's normal only."""
    whole, _ = swung((0.5,))
    with pytest.warns(rf.RigidfxWarning, match="Symmetry on 'y0' - RigidFace 'x0': normal"):
        half, scene = swung((0.0,), rf.Symmetry("y0"))
    assert np.abs(whole[:, 2]).max() > 0.1
    assert half[:, :3] == pytest.approx(whole[:, :3], abs=1e-9)
    assert 2 * half[:, 3] == pytest.approx(whole[:, 3], rel=1e-9)
    rf.Scene(scene.domain, next(iter(scene.materials))[0], scene.effects)  # keeps what it has
    with pytest.raises(rf.SceneError, match=r"'y0' cuts RigidFace 'x0'.*MeanFace\('x0'\)"):
        swung((0.0,), rf.Symmetry("y0", until=1.0))

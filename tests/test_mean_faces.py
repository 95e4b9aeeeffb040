"""Mean faces turn with the rotation that fits them: no number depends on sides, place or cells."""

import numpy as np
import pytest
from common import boxes
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.mechanics.rotation import nearest_rotations

E = 2.1e11
STEEL = rf.StVenantKirchhoff(rho=7800.0, E=E, nu=0.3)
LENGTH, THICK = 1.0, 0.1  # m
SECOND = THICK**4 / 12


def test_the_fitted_rotation_is_proper():
    """Also of a flat face that is seen from behind."""
    axes = Rotation.random(random_state=4).as_matrix()
    H = np.array([0.0, 0.4, 0.6])[:, None] * axes
    assert nearest_rotations(H) == pytest.approx(axes, abs=1e-14)


def bar(cells, turn=(0, 0, 0)):
    """A bar along x, turned about the origin, and that rotation."""
    R, b = Rotation.from_rotvec(turn).as_matrix(), THICK / 2
    domain = rf.box((0, -b, -b), (LENGTH, b, b), cells)
    domain.mesh.geometry.x[:] = domain.mesh.geometry.x @ R.T
    return domain, R


@pytest.mark.parametrize("joint", ["Revolute", "Tied"])
def test_half_beams_that_are_joined_bend_as_a_whole_one(joint):
    """Flat faces of meshes that do not match; the hinge is locked by a motor."""
    b, seam = THICK / 2, 1e-7  # m
    halves = ((0, -b, -b), (0.5, b, b), (5, 2, 2)), ((0.5 + 2 * seam, -b, -b), (1, b, b), (6, 3, 3))
    domain = boxes(*halves)
    domain = domain.with_facets("a", lambda x: np.abs(x[0] - 0.5) < 0.5 * seam)
    domain = domain.with_facets("b", lambda x: np.abs(x[0] - 0.5 - 2 * seam) < 0.5 * seam)
    domain = domain.with_facets("root", lambda x: np.isclose(x[0], 0))
    domain = domain.with_facets("end", lambda x: np.isclose(x[0], 1))
    sides = rf.MeanFace("a"), rf.MeanFace("b"), (0.5 + seam, 0, 0)
    joints = [rf.Tied(*sides, name="h")]
    if joint == "Revolute":
        joints = [rf.Revolute(*sides, (0, 0, 1), name="h"), rf.Motor("h", angle=0.0)]
    for across in np.eye(3)[1:]:
        effects = [rf.Fixed("root"), *joints, rf.Traction("end", tuple(1e4 * across))]
        probes = {"end": (1, 0, 0)}
        scene = rf.Scene(domain, STEEL, effects, order=2, probes=probes)
        *_, joined = rf.static(scene, 1, verbose=False)
        whole = rf.box((0, -b, -b), (1, b, b), (11, 2, 2))
        effects = [rf.Fixed("x0"), rf.Traction("x1", tuple(1e4 * across))]
        scene = rf.Scene(whole, STEEL, effects, order=2, probes=probes)
        *_, one = rf.static(scene, 1, verbose=False)
        bent = float(joined.probes["end"] @ across / (one.probes["end"] @ across))
        assert bent == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("face", ["sides", "skin", "x1"])
def test_a_lever_on_a_motor_yields_alike_at_all_angles(face):
    """A face round its end, the same with the end, and the flat end; sides exchanged."""
    found = []
    for q, flip in ((0.0, False), (np.pi / 4, True), (3 * np.pi / 4, False)):
        domain, _ = bar((10, 2, 2))
        domain = domain.with_facets("skin", lambda x: x[0] > 0.9 - 1e-9)
        domain = domain.with_facets(
            "sides", lambda x: (x[0] > 0.9 - 1e-9) & np.isclose(np.abs(x[1:]).max(0), THICK / 2)
        )
        sides = ["ground", rf.MeanFace(face)]
        hinge = rf.Revolute(*sides[:: -1 if flip else 1], (1, 0, 0), (0, 0, 1), name="h")
        turned = rf.Motor("h", angle=lambda t, q=-q if flip else q: q * min(2 * t, 1.0))
        across = np.array([-np.sin(q), np.cos(q), 0])
        push = rf.Traction("x0", tuple(1e5 * across), time=lambda t: max(2 * t - 1, 0.0))
        probes = {"end": (0, 0, 0)}
        scene = rf.Scene(domain, STEEL, [hinge, turned, push], element="enhanced", probes=probes)
        *_, last = rf.static(scene, 8, verbose=False)
        place = last.probes["end"] - [1, 0, 0]  # from the hinge
        found.append(float(place @ across))
    assert found == pytest.approx([found[0]] * 3, rel=1e-5)


def test_a_hinge_between_two_parts_yields_alike_at_all_angles():
    """A lever on top of a square post, which bends alike towards all sides, is pushed across."""
    b, top = THICK / 2, 0.3
    post = (-b, -b, 0), (b, b, top), (2, 2, 4)
    domain = boxes(post, ((-b, -b, top + 1e-6), (1, b, top + THICK), (11, 2, 2)))
    domain = domain.with_facets("root", lambda x: np.isclose(x[2], 0))
    domain = domain.with_facets("top", lambda x: np.abs(x[2] - top) < 1e-7)
    domain = domain.with_facets("hub", lambda x: (x[0] < b + 1e-9) & (x[2] > top + 5e-7))
    domain = domain.with_facets("end", lambda x: np.isclose(x[0], 1))
    found = []
    for q, flip in ((0.0, False), (np.pi / 4, True), (3 * np.pi / 4, False)):
        sides = [rf.MeanFace("top"), rf.MeanFace("hub")]
        hinge = rf.Revolute(*sides[:: -1 if flip else 1], (0, 0, top), (0, 0, 1), name="h")
        turned = rf.Motor("h", angle=lambda t, q=-q if flip else q: q * min(2 * t, 1.0))
        across = np.array([-np.sin(q), np.cos(q), 0])
        push = rf.Traction("end", tuple(1e5 * across), time=lambda t: max(2 * t - 1, 0.0))
        effects = [rf.Fixed("root"), hinge, turned, push]
        scene = rf.Scene(domain, STEEL, effects, element="enhanced", probes={"end": (1, 0, 0.35)})
        *_, last = rf.static(scene, 8, verbose=False)
        place = last.probes["end"] + [1, 0, 0]  # from the hinge
        found.append(float(place @ across))
    assert found == pytest.approx([found[0]] * 3, rel=1e-5)


@pytest.mark.parametrize("face", [rf.MeanFace("x1"), rf.RigidFace("x1")])
@pytest.mark.parametrize("arm", [-0.3, 0.2])
def test_a_mass_beside_an_end_swings_as_beam_theory_has_it(face, arm):
    """The frequency of a beam of a hundredth of its mass, with coarse and fine cells."""
    light = rf.StVenantKirchhoff(rho=1e3, E=E, nu=0.0)
    shear = 2 * LENGTH / (5 / 6 * THICK**2 * E)
    bending = (LENGTH**3 / 3 + arm * LENGTH**2 + arm**2 * LENGTH) / (E * SECOND)
    exact = 1 / np.sqrt(1e3 * (bending + shear)) / (2 * np.pi)
    for cells in ((5, 1, 1), (20, 2, 2)):
        domain, _ = bar(cells)
        mass = rf.PointMass(face, 1e3, at=(1 + arm, 0, 0))
        scene = rf.Scene(domain, light, [rf.Fixed("x0"), mass], order=2, mass="consistent")
        assert rf.modes(scene, 1).frequencies[0] == pytest.approx(exact, rel=5e-3)


def test_a_mass_beside_its_face_weighs():
    """Static reactions are those of the weight and its arm."""
    domain, _ = bar((5, 1, 1))
    mass = rf.PointMass(rf.MeanFace("x1"), 10.0, at=(1.3, 0.2, 0))
    scene = rf.Scene(domain, STEEL, [rf.Fixed("x0"), mass, rf.Gravity((0, 0, -10.0))])
    *_, last = rf.static(scene, 1, verbose=False)
    own = 780.0
    assert last.reactions["x0"] == pytest.approx([0, 0, own + 100], abs=1e-6)
    assert last.reaction_moments["x0"] == pytest.approx([100 * 0.2, -(0.5 * own + 130), 0], abs=0.1)


def test_a_bar_twisted_between_flat_mean_faces_is_as_soft_as_its_page_says():
    """Of G J φ/L of its mesh, of whose ends two lengths know nothing: 0.995 and 0.991."""
    b, compliances = THICK / 2, []
    for length in (1.0, 0.5):
        domain, effects = rf.box((0, -b, -b), (length, b, b), (10, 4, 4)), []
        for x, angle in ((0, 0.0), (1, 1e-3)):
            at, name = (x * length, 0, 0), f"x{x}"
            effects += [rf.Revolute("ground", rf.MeanFace(name), at, (1, 0, 0), name=name)]
            effects += [rf.Motor(name, angle=lambda t, angle=angle: angle * t)]
        *_, last = rf.static(rf.Scene(domain, STEEL, effects, order=2), 1, verbose=False)
        (torque,) = last.joints["x1"].efforts.values()
        compliances.append(1e-3 / abs(torque))
    long, short = compliances
    GJ = 0.5 / (long - short)
    assert pytest.approx(0.1406 * THICK**4 * E / 2.6, rel=5e-3) == GJ
    assert [1 / (GJ * long), 0.5 / (GJ * short)] == pytest.approx([0.995, 0.991], abs=6e-4)

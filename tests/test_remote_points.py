"""Remote points: forces, torques, springs and masses at points of mean and rigid faces."""

import numpy as np
import pytest
from histories import imbalance
from joints import SOFT

import rigidfx as rf

NO_WARNINGS = pytest.mark.filterwarnings("ignore:Body")  # of few cells, whose lumped mass shows
BESIDE = 1.3, 0.1, 0.25  # m
FACES = {"mean": rf.MeanFace("ring"), "flat": rf.MeanFace("x1"), "rigid": rf.RigidFace("ring")}


def bar(*effects, **options):
    """A bar that tumbles, with the skin of its last cells as a face."""
    domain = rf.box((0, 0, 0), (1, 0.2, 0.2), (5, 2, 2))
    domain = domain.with_facets("ring", lambda x: x[0] > 0.8 - 1e-6)
    start = rf.InitialVelocity(linear=(0.1, 0, 0), angular=(0.3, 0.5, 1.5))
    return rf.Scene(domain, SOFT, [start, *effects], **options)


@NO_WARNINGS
@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_what_acts_at_a_point_keeps_energy_and_momenta(face, mass):
    """While cells become rigid and flexible, too; the point lies beside the face."""
    at = FACES[face]
    force, torque = np.array([30.0, 20.0, -10.0]), np.array([5.0, -8.0, 3.0])
    release = rf.Release(at=(0.15,))
    criterion = rf.StrainRate(1e9, 0.05, patience=1, wake="none", release=release)
    loads = [rf.Resultant(at, force=force, at=BESIDE), rf.Resultant(at, torque=torque)]
    weight = rf.PointMass(at, 7.0, at=BESIDE)
    scene = bar(*loads, weight, mass=mass)
    reports = list(rf.simulate(scene, 0.01, 0.25, rigidify=criterion))
    kinds = [event.kind for report in reports for event in report.events]
    assert kinds == ["freeze", "release", "freeze"]
    assert imbalance(reports) <= 1e-12
    for report in reports:
        gained = report.linear_momentum - reports[0].linear_momentum
        assert gained == pytest.approx(report.t * force, abs=1e-11)
    assert reports[0].linear_momentum[0] == pytest.approx(0.1 * 47.0)
    turned = list(rf.simulate(bar(loads[1], weight, mass=mass), 0.01, 0.1))
    gained = turned[-1].angular_momentum - turned[0].angular_momentum
    assert gained == pytest.approx(0.1 * torque, abs=1e-11)
    spring = rf.Spring(at, 2000.0, damping=3.0, at=BESIDE)
    reports = list(rf.simulate(bar(spring, weight, mass=mass), 0.01, 0.1))
    assert imbalance(reports) <= 1e-12
    assert reports[-1].springs > 1.0


@pytest.mark.parametrize("face", [rf.MeanFace("x1"), rf.RigidFace("x1")])
def test_a_mass_beside_its_face_is_a_body_that_is_tied_to_it(face):
    """A rigid bar and the point turn about their common centre as one body."""
    scene = bar(rf.PointMass(face, 7.0, at=BESIDE))
    domain = scene.domain.with_cells("all", lambda x: x[0] > -1)
    first, *_, last = rf.simulate(
        rf.Scene(domain, SOFT, [rf.Rigid("all"), *scene.effects]), 0.01, 0.3
    )
    for report in (first, last):
        whole, point = report.rigid
        assert (whole.data.mass, point.data.mass) == pytest.approx((40.0, 7.0))
        at = whole.motion.r + whole.motion.R @ (np.array(BESIDE) - whole.data.origin)
        assert point.motion.r == pytest.approx(at, abs=1e-12)
        speed = whole.motion.velocity
        speed = speed + np.cross(whole.motion.angular_velocity, at - whole.motion.r)
        assert point.motion.velocity == pytest.approx(speed, abs=2e-4 * np.linalg.norm(speed))
    assert last.energy == pytest.approx(first.energy, rel=1e-12)


@pytest.mark.filterwarnings("ignore")  # of blows by hinge and lock
def test_a_mass_beside_its_face_stays_one_body(tmp_path):
    """The structure is bound anew where effects begin, and where runs resume."""

    def scene():
        hinge = rf.Revolute("ground", rf.MeanFace("x0"), (0, 0.1, 0.1), (0, 0, 1), name="h")
        lock = rf.Motor("h", speed=0.0, since=0.05)
        return bar(hinge, lock, rf.PointMass(rf.MeanFace("x1"), 7.0, at=BESIDE))

    *_, whole = rf.simulate(scene(), 0.01, 0.15)
    for _ in rf.simulate(scene(), 0.01, 0.1, checkpoint=rf.Checkpoint(tmp_path, steps=100)):
        pass
    *_, resumed = rf.resume(tmp_path, scene(), t_end=0.15)
    assert len(whole.rigid) == len(resumed.rigid) == 1
    assert resumed.energy == pytest.approx(whole.energy, rel=1e-10)


@NO_WARNINGS
@pytest.mark.parametrize("face", FACES.values())
def test_a_description_counts_the_unknowns_of_faces_and_masses(face):
    """It had none of masses beside their faces, and all of the nodes of rigid faces."""
    scene = bar(rf.PointMass(face, 7.0, at=BESIDE), rf.Gravity())
    *_, report = rf.simulate(scene, 1e-3, 1e-3)
    assert f"; {report.unknowns} unknowns at the start" in scene.describe(periods=0)


@NO_WARNINGS
@pytest.mark.parametrize("face", [rf.MeanFace("x1"), rf.RigidFace("x1")])
def test_points_bend_a_cantilever_as_theory_has_it(face):
    """An end moment rolls it up; a mass beyond its end makes its first frequencies."""
    b, E = 0.1, 1e6
    domain = rf.box((0, 0, 0), (1, b, b), (20, 2, 2))
    material = rf.StVenantKirchhoff(rho=1.0, E=E, nu=0.0)

    def scene(*effects):
        held = rf.Fixed("x0"), *effects
        probes = {"end": (1, b / 2, b / 2)}
        return rf.Scene(domain, material, held, element="enhanced", probes=probes)

    stiffness, torque = E * b**4 / 12, 8.0
    *_, rolled = rf.static(scene(rf.Resultant(face, torque=(0, 0, torque))), 2)
    k = torque / stiffness
    exact = np.array([np.sin(k) / k - 1, (1 - np.cos(k)) / k, 0])
    assert rolled.probes["end"] == pytest.approx(exact, abs=5e-3)
    assert rolled.reaction_moments["x0"] == pytest.approx([0, 0, -torque], abs=1e-9)
    if face == rf.MeanFace("x1"):
        with pytest.warns(rf.RigidfxWarning, match="1 m away from the middle of MeanFace"):
            far = scene(rf.PointMass(face, 10.0, at=(2, b / 2, b / 2)))
        heavy = rf.modes(far, 1)
        assert heavy.squares[0] == pytest.approx(stiffness * 3 / 7 / 10, rel=1e-2)
    sprung = rf.modes(scene(rf.Spring(face, 1e4, at=(1, b / 2, b / 2))), 1)
    assert sprung.squares[0] > 5 * rf.modes(scene(), 1).squares[0]

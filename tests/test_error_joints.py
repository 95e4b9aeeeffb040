"""The twin's joints hold u + e: a closed chain through half a turn, rigid all through."""

from __future__ import annotations

import warnings
from functools import partial

import numpy as np
import pytest
from four_bars import MOTOR, driven, four_bars
from joints import follow
from test_contact_pairs import boxes

import rigidfx as rf

DT = 4e-3  # s
SPRUNG = partial(four_bars, MOTOR, rf.JointSpring("D", stiffness=30.0, damping=0.2))


def tips(scene, t_end, rule, dt=DT):
    """Tip in u + e and e, and unknowns, of each report."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = [
            (report.probes["tip"], report.error_motion["tip"], report.unknowns)
            for report in rf.simulate(scene, dt, t_end, rigidify=rule, progress=False)
        ]
    return np.array([of[:2] for of in found]), [of[2] for of in found]


def errors(scene, t_end, rule, dt=DT):
    """Errors of u and of u + e at the tip against a flexible twin [m], and the run's unknowns."""
    twin, _ = tips(scene(), t_end, rf.StrainRate(0.0, 1e9, wake="none"), dt)
    run, unknowns = tips(scene(), t_end, rule, dt)
    shown = run[:, 0] - run[:, 1], run[:, 0]
    return *(np.linalg.norm(twin[:, 0] - x, axis=1) for x in shown), unknowns


def test_what_joints_hold_is_corrected():
    """Bars that are rigid bend in e, and move each other by that; three rows follow from others.

    Released by a blow they have turned against each other: what is let down pushes e in each.
    """
    begun = 70  # steps

    def blow(t):
        s = (t / DT - begun) / 10
        return np.sin(np.pi * s) ** 2 if 0 < s < 1 else 0.0

    def scene():
        return SPRUNG(rf.Traction("coupler 1", (0, 3e5, 0), time=blow), rf.NumericalDamping(0.1))

    off, left, unknowns = errors(scene, 0.312, rf.StrainRate(2e-3, 0.06))
    assert unknowns[begun] == 18
    assert unknowns[-1] == 156
    assert off[:begun].max() > 1e-4
    assert left[:begun].max() <= 0.02 * off[:begun].max()
    assert left[begun:].max() <= 0.1 * off[begun:].max()


def test_rigid_faces_are_rigid_in_the_twin():
    """By faces that strain in e, 0.3 of the error would be left."""
    scene = partial(SPRUNG, face=rf.RigidFace)
    off, left, unknowns = errors(scene, 0.2, rf.StrainRate(1e9, 0.06))
    assert unknowns[-1] == 18
    assert off.max() > 1e-4
    assert left.max() <= 0.1 * off.max()


def rail(*effects):
    """A bar on a rail, pushed along it at its tip."""
    box = boxes(((0, 0, 0), (4, 1, 1), (8, 1, 1))).with_facets("root", lambda x: x[0] < 1 + 1e-9)
    box = box.with_facets("tip", lambda x: x[0] > 4 - 1e-9)
    box = box.with_cells("a", lambda x: x[0] <= 2 + 1e-9).with_cells(
        "b", lambda x: x[0] >= 2 - 1e-9
    )
    soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
    slide = rf.Prismatic("ground", rf.MeanFace("root"), (0.5, 0.5, 0.5), (0, 0, 1), name="rail")
    push = rf.Traction("tip", (0, 0, 100.0), time=lambda t: np.sin(2 * np.pi * t))
    probes, every = {"tip": (4, 0.5, 0.5)}, (slide, push, rf.MassDamping(0.5), *effects)
    return rf.Scene(box, {"a": soft, "b": stiff}, every, probes=probes)


@pytest.mark.parametrize(
    "held",
    [
        (rf.JointSpring("rail", stiffness=2e3, damping=50.0),),
        (rf.Spring(rf.MeanFace("root"), (0, 0, 2e3)), rf.Motor("rail", rate=0.0, since=1.2)),
    ],
    ids=["spring", "lock"],
)
def test_springs_and_locks_of_joints_hold_the_twin(held):
    """A lock where the twin is when it begins; u + e was off by 1 and 0.75 of the error of u."""
    off, left, _ = errors(partial(rail, *held), 2.0, rf.StrainRate(2e-3, 0.4, kappa=6), 0.02)
    assert off.max() > 1e-4
    assert left.max() <= 0.02 * off.max()


def test_a_drive_that_begins_strikes_the_twin():
    """Which is flexible where bodies are: by the blow to bodies u + e was as far off as u."""
    lock = rf.Motor("A", speed=0.0, since=0.3)
    drive = rf.Motor("A", speed=driven, until=0.3)
    scene = partial(four_bars, drive, lock, rf.NumericalDamping(0.1))
    off, left, _ = errors(scene, 0.4, rf.StrainRate(0.03, 0.06))
    assert off.max() > 1e-3
    assert left.max() <= 0.1 * off.max()


def test_what_joints_leave_free_is_not_shown():
    """The phase of a chain that swings by itself would be lost."""
    run, unknowns = tips(four_bars(rf.Gravity((0, -9.81, 0))), 0.2, rf.StrainRate(1e9, 0.06))
    assert unknowns[-1] < 156
    np.testing.assert_array_equal(run[:, 1], 0.0)


def closed_chain(mass):
    """Four flexible bars in a square that folds while it tumbles; nothing holds it.

    Bent out of its plane a chain of hinges alone would lock while it is rigid.
    """
    n, w, g = (4, 1, 1), 0.05, 0.08
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    own = []
    for k in range(4):
        a, b = sorted((corners[k], corners[(k + 1) % 4]), key=tuple)
        along = (b - a) @ (b - a) * (b - a)
        low, high = a + g * along - w * (1 - along), b - g * along + w * (1 - along)
        own.append((tuple(low), tuple(high), n if along[0] else (1, 4, 1)))
    domain = boxes(*own)
    joints = []
    for k in range(4):
        for j, bar in ((k, k), (k, (k - 1) % 4)):
            low, high, _ = (np.array(of) for of in own[bar])
            near = partial(_near, low, high, corners[j])
            domain = domain.with_facets(f"{bar} at {j}", near)
        sides = rf.MeanFace(f"{k} at {k}"), rf.MeanFace(f"{(k - 1) % 4} at {k}")
        axis = () if k == 2 else ((0, 0, 1),)
        kind = (rf.Revolute, rf.Cylindrical, rf.Spherical, rf.Revolute)[k]  # 17 rows of 24
        joints.append(kind(*sides, tuple(corners[k]), *axis))

    def folding(x):
        spin = np.cross((0.4, -0.3, 1.0), x.T - 0.5).T
        return spin + 0.5 * np.stack([x[1] - 0.5, x[0] - 0.5, 0 * x[0]])

    soft = rf.StVenantKirchhoff(rho=1000.0, E=1e7, nu=0.3)
    start = rf.InitialVelocity(function=folding)
    return rf.Scene(domain, soft, [*joints, start], mass=mass, element="enhanced")


def _near(low, high, corner, x):
    """Nodes of a bar's last layer of cells at a corner."""
    inside = ((x >= low[:, None] - 1e-9) & (x <= high[:, None] + 1e-9)).all(axis=0)
    return inside & (np.abs(x - corner[:, None]).max(axis=0) <= 0.08 + 0.21 + 1e-9)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_closed_chain_keeps_energy_and_momenta_through_switches(mass):
    """All four bars freeze, are released and freeze anew."""
    release = rf.Release(at=(0.15,))
    rule = rf.StrainRate(1e9, 0.06, patience=1, wake="none", release=release)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reports, H, L, J, held = follow(closed_chain(mass), 0.01, 25, rigidify=rule)
    assert [e.kind for r in reports for e in r.events] == ["freeze", "release", "freeze"]
    assert reports[-1].unknowns == 24
    assert max(H, L, J) <= 1e-11
    assert held[0] <= 1e-13


def test_a_mass_on_two_parts_couples_the_columns_of_their_joints():
    """Two arms, held at their roots and by joints, with one mass on the mean of both tips."""

    def scene():
        two = boxes(((0, 0, 0), (1, 0.1, 0.1), (8, 1, 1)), ((0, 1, 0), (1, 1.1, 0.1), (8, 1, 1)))
        two = two.with_facets("roots", lambda x: x[0] < 1e-9)
        two = two.with_facets("tips", lambda x: x[0] > 1 - 1e-9)
        effects = [rf.Fixed("roots"), rf.PointMass(rf.MeanFace("tips"), 5.0)]
        for name, y in (("A", 0.0), ("B", 1.0)):
            two = two.with_facets(
                name, lambda x, y=y: (abs(x[0] - 0.5) < 0.13) & (abs(x[1] - y - 0.05) < 0.06)
            )
            effects.append(
                rf.Cylindrical("ground", rf.MeanFace(name), (0.5, y + 0.05, 0.05), (0, 0, 1))
            )
        two = two.with_facets("pushed", lambda x: (x[0] > 1 - 1e-9) & (x[1] < 0.5))
        material = rf.StVenantKirchhoff(E=1e7, nu=0.3, rho=1000.0)
        effects.append(rf.Traction("pushed", (0, 0, 200.0), until=0.2))
        return rf.Scene(two, material, effects, probes={"tip": (1, 0.05, 0.05)})

    off, left, unknowns = errors(scene, 1.0, rf.StrainRate(3e-2, 0.1, patience=1), 0.01)
    assert unknowns[-1] < unknowns[0]
    assert left.max() <= 0.05 * off.max()


def gate():
    """Two bars that swing up against each other, and a weight in springs at their mean end."""
    mesh = boxes(
        ((0, 0, 0), (3, 0.4, 0.4), (6, 1, 1)),
        ((4, 0, 0), (7, 0.4, 0.4), (6, 1, 1)),
        ((3.3, -2.5, 0), (3.7, -0.5, 0.4), (1, 3, 1)),
    )
    mesh = mesh.with_cells("weight", lambda x: x[1] <= -0.5 + 1e-9)
    mesh = mesh.with_facets("hook", lambda x: abs(x[1] + 0.5) < 1e-9)
    mesh = mesh.with_facets("ends", lambda x: (abs(abs(x[0] - 3.5) - 0.5) < 1e-9) & (x[1] > -1e-9))
    for name, root in (("root A", 0), ("root B", 7)):
        mesh = mesh.with_facets(name, lambda x, at=root: abs(x[0] - at) < 1e-9)

    def angle(t):
        return 0.6 * np.sin(np.pi * t / 1.5) ** 2 * min(t / 1.5, 1) ** 2

    effects = [
        rf.Revolute("ground", rf.MeanFace("root A"), (0, 0.2, 0.2), (0, 0, 1), name="A"),
        rf.Revolute("ground", rf.MeanFace("root B"), (7, 0.2, 0.2), (0, 0, 1), name="B"),
        rf.Motor("A", angle=lambda t: -angle(t)),
        rf.Motor("B", angle=angle),
        rf.Spherical(rf.MeanFace("ends"), rf.MeanFace("hook"), (3.5, -0.25, 0.2)),
        rf.Spring("weight", (1e5, 2e4, 1e5), (1e3, 2e2, 1e3)),
    ]
    steel = rf.StVenantKirchhoff(E=1e8, nu=0.3, rho=1000.0)
    return rf.Scene(mesh, steel, effects, probes={"tip": (3.5, -2.5, 0.2)})


def test_a_face_of_two_parts_has_a_share_in_each():
    """Which turn against each other: with one rotation for both 0.057 of the error was left."""
    off, left, unknowns = errors(gate, 1.0, rf.StrainRate(1e9, 0.1), 0.01)
    assert unknowns[-1] == 18
    assert off.max() > 0.05
    assert left.max() <= 0.03 * off.max()

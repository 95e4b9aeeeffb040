"""Reduced parts at joints: each kind beside its flexible twin, mechanisms, ranks, restarts."""

from functools import partial

import numpy as np
import pytest
from common import boxes
from four_bars import MOTOR, bricard, four_bars
from histories import gone_on, imbalance, tips
from joints import apart
from parallel import check_the_same, report

import rigidfx as rf

METAL = rf.StVenantKirchhoff(E=1e9, nu=0.3, rho=1000.0)
PIN, Z = (1.01, 0.1, 0.1), (0, 0, 1)
DT, STEPS = 2e-3, 25
BOTH = (rf.Reduced("A"), rf.Reduced("B"))
HINGE = rf.Revolute(rf.MeanFace("a"), rf.MeanFace("b"), PIN, Z, name="hinge")
FAR = rf.MeanFace("far")
PUSH = rf.Traction("far", (0, 300.0, 100.0), time=lambda t: np.sin(30 * t))
pytestmark = pytest.mark.filterwarnings("ignore:Scene. first-order:rigidfx.RigidfxWarning")


def turning(apart, x):
    """Both bars turn, the second one faster about z by `apart` [rad/s]."""
    omega = np.array([[0.3], [-0.2], [1.5]]) + np.array([[0.0], [0.0], [apart]]) * (x[:1] > PIN[0])
    return np.cross(omega.T, x.T - PIN).T


def bars(*effects, thrown=True, apart_by=2.0, **options):
    """Two bars along x; "a" and "b" are their ends at a pin."""
    domain = boxes(
        ((0, 0, 0), (1, 0.2, 0.2), (5, 2, 2)), ((1.02, 0, 0), (2.02, 0.2, 0.2), (5, 2, 2))
    )
    sets = {"A": (0, 1), "B": (1.02, 3), "inner": (0.4, 1), "outer": (1.42, 3)}
    sets |= {"hub": (0, 0.2), "arm": (0.2, 1)}
    for name, (low, high) in sets.items():
        domain = domain.with_cells(
            name, lambda x, a=low, b=high: (x[0] > a - 0.01) & (x[0] < b + 0.01)
        )
    sets = {"a": (0.8, 1), "b": (1.02, 1.22), "near": (0, 0), "far": (1.82, 3)}
    for name, (low, high) in sets.items():
        domain = domain.with_facets(
            name, lambda x, a=low, b=high: (x[0] > a - 0.01) & (x[0] < b + 0.01)
        )
    start = [rf.InitialVelocity(function=partial(turning, apart_by))] if thrown else []
    tip = {"tip": (2.02, 0.2, 0.2)}
    return rf.Scene(domain, METAL, [*start, *effects], probes=tip, **options)


def run(scene, dt=DT, steps=STEPS):
    """Reports; the largest error of the energy, relative, and the largest gap of a joint [m]."""
    reports, open_by = [], 0.0
    for found in rf.simulate(scene, dt, steps * dt):
        reports.append(found)
        if found.step % 5 == 0:
            open_by = max(open_by, apart(scene, found.state)[0])
    return reports, imbalance(reports), open_by


A, B = HINGE.sides
ASIDE = {"at": (2.2, 0.3, 0.1)}
KINDS = {
    "spherical": [
        rf.Spherical(A, B, PIN),
        rf.SpringDamper(rf.MeanFace("near"), FAR, 500.0, damping=1.0),
    ],
    "cylindrical": [rf.Cylindrical(A, B, PIN, Z), rf.PointMass(FAR, 2.0)],
    "prismatic": [rf.Prismatic(A, B, PIN, (1, 0, 0))],
    "universal": [
        rf.Universal(A, B, PIN, Z, (0, 1, 0)),
        rf.Resultant(FAR, (0, 20.0, 5.0), (1.0, 2.0, 0.0), **ASIDE),
    ],
    "tied": [rf.Tied(A, B, PIN), rf.Spring(FAR, 500.0, **ASIDE)],
    "motor": [
        HINGE,
        rf.Motor("hinge", speed=lambda t: 2 + 5 * np.sin(10 * t) ** 2),
        rf.PointMass(FAR, 2.0, **ASIDE),
    ],
    "stop": [
        HINGE,
        rf.Motor("hinge", torque=lambda t: 5 * np.sin(10 * t)),
        rf.JointSpring("hinge", stiffness=100.0, damping=1.0),
        rf.Stop("hinge", high=0.05, stiffness=1e4),
    ],
}


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_moves_as_its_flexible_twin(kind):
    """The way to 1e-6, 1e-4 where joints bend the bars; energy 1e-12, joints closed to 1e-14 m."""
    stiff = kind in ("prismatic", "tied")
    allowed, start = 1e-4 if stiff else 1e-6, {"apart_by": 0.0 if stiff else 2.0}
    effects = KINDS[kind]
    (own, energy, open_by), (twin, _, _) = (
        run(bars(*effects, *parts, **start)) for parts in (BOTH, ())
    )
    assert own[-1].unknowns < twin[-1].unknowns / 4
    assert energy < 1e-12
    assert open_by < 1e-14
    assert np.abs(tips(own) - tips(twin)).max() < allowed * np.abs(tips(twin)).max()


@pytest.mark.parametrize(
    "case", ["free", "held", "moved", "turned", "one", "halves", "beside a rigid one"]
)
def test_they_move_and_push_as_the_twin_does(case):
    """Beside flexible cells, on supports and beside rigid parts; forces of the hinge to 0.2 %."""
    path = rf.PrescribedMotion("near", displacement=lambda t: (0, 0.1 * t * t, 0))
    turned = rf.PrescribedRotation("near", axis=Z, angle=lambda t: 2 * t * t)
    parts, held, mass = {
        "free": (BOTH, [], "consistent"),
        "held": (BOTH, [rf.Fixed("near")], "lumped"),
        "moved": (BOTH, [path], "consistent"),
        "turned": (BOTH, [turned], "lumped"),
        "one": (BOTH[:1], [], "lumped"),
        "halves": ((rf.Reduced("inner"), rf.Reduced("outer")), [], "consistent"),
        "beside a rigid one": ((rf.Reduced("A"), rf.Rigid("B")), [], "lumped"),
    }[case]
    rigid = parts[1:] if case.startswith("beside") else ()
    twin, own = (
        run(bars(HINGE, PUSH, *held, *some, thrown=not held, mass=mass)) for some in (rigid, parts)
    )
    assert own[1] < 1e-11
    assert own[2] < 1e-14
    ways = [tips(of[0]) for of in (own, twin)]
    forces = [np.array([r.joints["hinge"].force for r in of[0][1:]]) for of in (own, twin)]
    # Strains of second order are not in the shapes of a bar that bends while it is driven: 24, 36
    # and 60 shapes err by the same 1.9e-4.
    for (a, b), allowed in ((ways, 3e-4 if case == "turned" else 1e-4), (forces, 2e-3)):
        assert np.abs(a - b).max() < allowed * np.abs(b).max()


def test_joints_hold_what_is_rigid_in_a_part_by_its_name():
    """It was refused, as no Rigid part of that name."""
    effects = [
        rf.Revolute("ground", "hub", (0.1, 0.1, 0.1), Z, name="root"),
        rf.JointSpring("root", stiffness=300.0),
        *(HINGE, PUSH, rf.Rigid("hub")),
    ]
    own, twin = (run(bars(*effects, *some, thrown=False)) for some in ([rf.Reduced("arm")], []))
    assert own[0][-1].bodies[0].name == "arm + hub"
    assert own[1] < 1e-11
    assert own[2] < 1e-14
    assert np.abs(tips(own[0]) - tips(twin[0])).max() < 1e-4 * np.abs(tips(twin[0])).max()


@pytest.mark.filterwarnings("ignore:Reduced 'all cells 3'")  # ν of 0.5 %, at an error of 4e-7 m
def test_a_four_bar_linkage_bends_as_its_twin():
    """Rigid bars are off by 500 times as much."""
    twin, own = (run(four_bars(MOTOR, *some), 4e-3, 80) for some in ([], [rf.Reduced()]))
    assert own[0][-1].unknowns < twin[0][-1].unknowns
    assert len(own[0][-1].bodies) == 3
    assert own[1] < 1e-10
    assert own[2] < 1e-12
    assert np.abs(tips(own[0]) - tips(twin[0])).max() < 2e-6


def test_bricard_s_mechanism_of_reduced_bars_falls_as_its_twin():
    """One row of its joints follows from others."""
    twin, own = (run(bricard(*some), 5e-3, 40) for some in ([], [rf.Reduced()]))
    assert own[0][-1].unknowns < twin[0][-1].unknowns / 2
    assert own[1] < 1e-12
    assert own[2] < 1e-13
    assert np.abs(tips(own[0]) - tips(twin[0])).max() < 1e-3 * np.abs(tips(twin[0])).max()


def spun(ratio, *parts):
    """Lag of the tip of a beam that a motor spins up to a part of its first frequency [m]."""
    first = 3.516 * 0.04 * np.sqrt(7e10 / 12 / 2700.0)  # rad/s, clamped
    end = 6 * np.pi / first

    def speed(t):
        s = min(t / end, 1.0)
        return ratio * first * (s - np.sin(2 * np.pi * s) / (2 * np.pi))

    beam = rf.box((0, 0, 0), (1.0, 0.04, 0.04), (6, 1, 1))
    beam = beam.with_facets("root", lambda x: x[0] < 0.17)
    metal = rf.StVenantKirchhoff(E=7e10, nu=0.0, rho=2700.0)
    hinge = rf.Revolute("ground", rf.MeanFace("root"), (0, 0, 0.02), Z, name="hinge")
    effects, tip = [hinge, rf.Motor("hinge", speed=speed), *parts], {"tip": (1.0, 0, 0)}
    scene = rf.Scene(beam, metal, effects, element="enhanced", probes=tip)
    lags = []
    for r in rf.simulate(scene, end / 60, 1.1 * end):
        angle = r.joints["hinge"].angle if r.step else 0.0
        x, y, _ = r.probes["tip"] + (1.0, 0, 0)
        lags.append(y * np.cos(angle) - x * np.sin(angle))
    return np.array(lags)


@pytest.mark.filterwarnings("ignore:Reduced 'all cells'. at t:rigidfx.RigidfxWarning")
@pytest.mark.parametrize(("ratio", "allowed"), [(0.1, 2e-3), (0.5, 5e-3), (1.5, 0.011)])
def test_a_beam_that_a_motor_spins_up_lags_as_its_twin(ratio, allowed):
    """The hinge's force stiffens it. At 1.5 of its first frequency it would err by 24 % without."""
    twin, own = spun(ratio), spun(ratio, rf.Reduced())
    assert np.abs(own - twin).max() < allowed * np.abs(twin).max()


def test_a_restart_goes_on_with_the_same_digits(tmp_path):
    scene = partial(bars, HINGE, PUSH, rf.Motor("hinge", speed=2.0), *BOTH)
    whole = list(rf.simulate(scene(), DT, 8 * DT))
    *_, last = gone_on(scene, DT, 8 * DT, rf.Checkpoint(tmp_path, steps=1), 5)
    assert last.probes["tip"] == pytest.approx(whole[-1].probes["tip"], rel=1e-12)
    q = whole[-1].state.bodies.q
    assert last.state.bodies.q == pytest.approx(q, abs=1e-12 * np.abs(q).max())


def _found():
    """What is the same on any number of ranks."""
    free, held = bars(HINGE, PUSH, *BOTH), bars(HINGE, PUSH, rf.Fixed("near"), *BOTH, thrown=False)
    half = bars(HINGE, rf.Motor("hinge", speed=2.0), rf.Reduced("inner"), mass="consistent")
    ends = [list(rf.simulate(scene, DT, 10 * DT))[-1] for scene in (free, held, half)]
    pairs = [(r.probes["tip"], r.joints["hinge"].force) for r in ends]
    return [[x, f] for way, force in pairs for x, f in zip(way, force, strict=True)]


@pytest.mark.parallel
def test_it_is_the_same_on_several_ranks():
    check_the_same(__file__, 3, _found())


if __name__ == "__main__":
    report(_found())


def on_a_pad(*effects):
    """A block on a hinge at a rigid face in its corner."""
    domain = rf.box((0, 0, 0), (0.6, 0.4, 0.4), (6, 4, 4)).with_cells("half", lambda x: x[0] < 0.31)
    pad = rf.RigidFace("pad")
    domain = domain.with_facets(pad.where, lambda x: (x[0] < 1e-9) & (x[1:] < 0.21).all(axis=0))
    hinge = rf.Revolute("ground", pad, (0, 0.1, 0.1), (0, 1, 0))
    push = rf.Traction("x1", (0, 3e3, 0), until=0.03)
    probes = {"tip": (0.6, 0.4, 0.4)}
    return rf.Scene(domain, METAL, [hinge, push, *effects], probes=probes, element="enhanced")


def test_a_rigid_face_of_a_part_is_rigid_in_each_of_its_shapes():
    """A mean face in its place turns the block by 3 % more."""
    twin = tips(run(on_a_pad(), steps=20)[0])
    reports, energy, _ = run(on_a_pad(rf.Reduced("half")), steps=20)
    assert energy < 1e-11  # 3e-12 with flexible cells, too
    assert np.abs(tips(reports) - twin).max() < 5e-4 * np.abs(twin).max()

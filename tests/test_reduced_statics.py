"""Statics of reduced parts beside their flexible twins: displacements, stresses, reactions."""

from functools import partial

import numpy as np
import pytest
from parallel import check_the_same, report
from test_reduced import SOFT
from test_reduced import bar as any_bar
from test_reduced_joints import BOTH, HINGE, bars

import rigidfx as rf

CLAMP, PUSH = rf.Fixed("x0"), rf.Traction("x1", (0, 0, 300.0))
DOWN = rf.Gravity((0, 0, -1.0))
DRIVEN = rf.Motor("hinge", torque=9.0)
TURNED = rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=lambda t: 0.5 * t)


PROBES = {"tip": (1.0, 0.05, 0.05), "inside": (0.25, 0.05, 0.1)}
bar = partial(any_bar, probes=PROBES, element="enhanced")


CASES = {
    "clamped": (bar, [CLAMP, PUSH], ["half"]),
    "pulled": (bar, [CLAMP, rf.Traction("x1", (1e4, 0, 300.0))], ["end"]),
    "its weight": (bar, [CLAMP, DOWN], [None]),
    "on springs": (bar, [rf.Spring("x0", 1e6), rf.Spring("x1", 1e5), DOWN], ["half"]),
    "turned": (bar, [TURNED, PUSH], ["half"]),
    "all reduced": (
        partial(bars, thrown=False),
        [HINGE, rf.Fixed("near"), rf.JointSpring("hinge", 300.0), DOWN, DRIVEN],
        ["A", "B"],
    ),
    "hinged": (
        partial(bars, thrown=False),
        [HINGE, rf.Fixed("near"), rf.Spring("far", 1e5), rf.Traction("far", (0, 300.0, 100.0))],
        ["A", "B"],
    ),
}


def off(own, twin):
    return np.abs(np.subtract(own, twin)).max() / np.abs(twin).max()


@pytest.mark.filterwarnings("ignore:Scene. first-order")
@pytest.mark.parametrize("case", CASES)
def test_equilibria_are_those_of_the_flexible_twin(case):
    made, effects, parts = CASES[case]
    *_, own = rf.static(made(*effects, *map(rf.Reduced, parts)), 2)
    *_, twin = rf.static(made(*effects), 2)
    assert own.unknowns < 0.75 * twin.unknowns
    assert all(0 < body.nu < 1e-3 for body in own.bodies)
    assert off(own.probes["tip"], twin.probes["tip"]) < 1e-3
    assert own.energy == pytest.approx(twin.energy, rel=1e-3)
    assert own.work_of_loads == pytest.approx(twin.work_of_loads, rel=2e-3)
    for name, force in twin.reactions.items():
        assert off(own.reactions[name], force) < 1e-5
        assert off(own.reaction_moments[name], twin.reaction_moments[name]) < 1e-5
    for name, joint in twin.joints.items():
        assert off(own.joints[name].force, joint.force) < 1e-4
    if "inside" in twin.probes:
        stresses = [r.stresses["inside"].stress for r in (own, twin)]
        assert off(*stresses) < 2e-3


@pytest.mark.parametrize("stiffness", [1e4, 1e6, 1e8])
def test_a_part_on_springs_bends_as_its_twin(stiffness):
    """With shapes of loads without springs it bent by a seventieth of that on stiff ones."""
    domain = rf.box((0, 0, 0), (1.0, 0.05, 0.02), (12, 2, 1))
    feet = domain.with_facets("feet", lambda x: (x[2] < 1e-9) & (abs(x[0] - 0.5) > 0.4))
    time = rf.Table((0, 0.02, 0.05), (0, 1, 0))
    load, known = rf.Traction("z1", (0, 0, 0.3)), {"element": "enhanced"}
    pulse = rf.Traction("z1", (0, 0, 0.3), time=time)

    def middles(load, *parts):
        effects = [rf.Spring("feet", stiffness), load, *parts]
        scene = rf.Scene(feet, SOFT, effects, probes={"mid": (0.5, 0.05, 0.02)}, **known)
        found = rf.static(scene, 1) if load.time is None else rf.simulate(scene, 2e-3, 0.1)
        return np.array([r.probes["mid"] for r in found])

    for acts, allowed in ((load, 2e-4), (pulse, 2e-3)):
        assert off(middles(acts, rf.Reduced()), middles(acts)) < allowed


def test_a_bend_does_not_strain_what_is_rigid_in_a_part():
    """By the square of its turn ν would be 0.9 %, and a frequency 0.7 % too high."""
    push = rf.Resultant(rf.RigidFace("x1"), force=(0, 0, 60.0))
    (own, nu), (twin, _) = (
        (rf.modes(scene, 2, about=at).frequencies, at.bodies[0].nu)
        for scene in (bar(CLAMP, push, rf.Reduced()), bar(CLAMP, push))
        for at in [list(rf.static(scene, 1))[-1]]
    )
    assert 0 < nu < 1e-3
    assert off(own, twin) < 1e-3


def test_a_rigid_part_that_tension_would_stiffen_is_told():
    """ν was 0.04 % where the tip is 24 % off."""
    scene = bar(CLAMP, rf.Traction("x1", (1e5, 0, 100.0)), rf.Rigid("end"), rf.Reduced("rest"))
    with pytest.warns(rf.RigidfxWarning, match=r"amplitudes err"):
        list(rf.static(scene, 2))


def test_compliance_has_what_shapes_lack():
    found = rf.compliance(bar(CLAMP, PUSH, rf.Reduced("half")))
    assert 0 < found.taken["tip"] < 1e-3
    assert "reduced parts change its displacement by 0.0" in str(found)


def test_loads_that_shapes_lack_are_told():
    scene = bar(CLAMP, PUSH, rf.Traction("z1", (0, 300.0, 0)), rf.Reduced("half", shapes=1))
    with pytest.warns(rf.RigidfxWarning, match=r"lack more than 1% of the response to 1 of 2"):
        list(rf.static(scene, 1))


def test_motion_starts_from_the_equilibrium_of_reduced_parts():
    """It stays there under the same loads."""
    scene = bar(CLAMP, PUSH, rf.Reduced("half"))
    *_, found = rf.static(scene, 2)
    for r in rf.simulate(scene, dt=1e-3, t_end=0.02, start=found, progress=False):
        assert off(r.probes["tip"], found.probes["tip"]) < 2e-3


@pytest.mark.parametrize("first", [[], [rf.Reduced("half")]], ids=["flexible", "reduced"])
def test_a_run_starts_from_what_another_has_deformed(first):
    """It begins at rest, and swings as its flexible twin does."""
    domain = bar().domain

    def ends(steps, *effects, **start):
        probes = {"tip": (1.0, 0.05, 0.05)}
        scene = rf.Scene(domain, SOFT, [CLAMP, *effects], probes=probes, element="enhanced")
        return list(rf.simulate(scene, 2e-3, 2e-3 * steps, **start))

    bent = ends(10, rf.Gravity((0, 0, -1.0)), *first)[-1]
    own, twin = (
        [r.probes["tip"] for r in ends(20, *parts, start=bent)]
        for parts in ([rf.Reduced("half")], [])
    )
    assert off(own, twin) < 1e-3


PULLED = rf.Traction("x1", (0, 0, 300.0), time=lambda t: np.sin(50 * t))
FORCES = {
    "a force at a face": [rf.Resultant(rf.MeanFace("x1"), force=(0, 0, 3.0))],
    "a torque at a face": [rf.Resultant(rf.MeanFace("x1"), torque=(0, 3.0, 0))],
    "a pressure that follows": [rf.Pressure("z1", 300.0)],
    "let go from a preload": [rf.Preload((rf.Traction("x1", (0, 0, 300.0)),))],
}


@pytest.mark.parametrize("case", FORCES)
def test_motions_under_other_forces_are_those_of_the_flexible_twin(case):
    tips = [
        [r.probes["tip"] for r in rf.simulate(bar(CLAMP, *FORCES[case], *more), 2e-3, 0.04)]
        for more in ([rf.Reduced("end")], [])
    ]
    assert off(*tips) < 2e-3


def test_step_control_counts_the_error_of_reduced_parts():
    """It keeps its promise with fewer steps, as shapes are slower than cells."""
    runs = []
    for more in ([rf.Reduced("half")], []):
        control = rf.StepControl(0.01, "tip", largest=5e-3)
        runs.append(list(rf.simulate(bar(CLAMP, PULLED, *more), control, 0.05)))
    own, twin = (run[-1] for run in runs)
    assert 0.5 * len(runs[1]) < len(runs[0]) <= len(runs[1])
    assert 0 < own.ledger.time.relative < 0.01
    assert off(own.probes["tip"], twin.probes["tip"]) < 0.01


def test_statics_with_contacts_say_that_parts_are_flexible(caplog):
    """Their cells are those of the twin."""
    floor = rf.Contact("z0", against=rf.Plane((0, 0, -0.01), (0, 0, 1)))
    with caplog.at_level("INFO", logger="rigidfx"):
        *_, own = rf.static(bar(CLAMP, PUSH, floor, rf.Reduced("half")), 1, verbose=True)
    assert "Reduced 'half': flexible in these statics" in caplog.text
    *_, twin = rf.static(bar(CLAMP, PUSH, floor), 1)
    assert off(own.probes["tip"], twin.probes["tip"]) < 1e-12


def _found():
    """What is the same on any number of ranks."""
    *_, one = rf.static(bar(CLAMP, PUSH, rf.Reduced("half")), 1)
    *_, two = rf.static(bars(*CASES["hinged"][1], *BOTH, thrown=False), 1)
    return [[*r.probes["tip"], r.energy] for r in (one, two)]


@pytest.mark.parallel
@pytest.mark.filterwarnings("ignore:Scene. first-order")
def test_statics_are_the_same_on_two_ranks():
    check_the_same(__file__, 2, _found())


if __name__ == "__main__":
    report(_found())

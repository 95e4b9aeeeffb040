"""Scenes that can be computed and are hardly meant are told, and right ones beside them are not."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rigidfx as rf

STEEL = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7850.0)
FORCE = (0.0, 0.0, 1e3)


def beam(*effects, material=STEEL, length=1.0):
    """A bar along x, clamped at its start unless other effects hold it."""
    size = length / 10
    box = rf.box((0, 0, 0), (length, size, size), (4, 1, 1)).with_cells(
        "end", lambda x: x[0] > 0.5 * length
    )
    tip = (length, size, size)
    return rf.Scene(box, material, effects, element="enhanced", probes={"tip": tip})


def told(scene, dt=1e-4, t_end=2e-4, **how):
    """Warnings of a run."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        list(rf.simulate(scene, dt, t_end, progress=False, verbose=False, **how))
    return [str(warning.message) for warning in found]


def load(where="x1", value=FORCE, **when):
    return rf.NodalForce(where, value, **when)


CLAMP = rf.Fixed("x0")
LATE = rf.Table((0.0, 1.0, 2.0), (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ([CLAMP, load(), load("y1", since=0.1)], ["NodalForce on 'y1': it does nothing"]),
        ([CLAMP, load(), load("y1", time=LATE)], ["NodalForce on 'y1': it does nothing"]),
        ([CLAMP, load(), load("y1", until=0.0)], ["NodalForce on 'y1': it does nothing"]),
        ([CLAMP, load(), load("x0")], ["NodalForce on 'x0': supports hold all nodes"]),
        (
            [rf.Fixed("x0", components="x"), CLAMP, rf.Pressure("x0", 1e3), load()],
            ["Pressure on 'x0': supports hold all nodes"],
        ),
        (
            [rf.Rigid("end"), rf.Fixed("x1"), rf.Traction("x1", FORCE), load("y1")],
            ["Traction on 'x1': supports hold all nodes"],
        ),
        ([CLAMP], ["Up to t = 0.0002 s nothing acts and nothing moves"]),
        ([CLAMP, load(), load("y1", since=1e-4)], []),
        ([CLAMP, load("x0", since=1e-4), rf.Gravity()], ["NodalForce on 'x0': supports hold"]),
        ([rf.Fixed("x0", until=1e-4), load("x0"), load()], []),
        ([rf.Fixed("x0", components="xy"), load("x0")], []),
        ([CLAMP, rf.Pressure("y1", 1e3)], []),
    ],
)
def test_effects_that_do_nothing_are_told(effects, words):
    found = told(beam(*effects))
    assert len(found) == len(words), found
    assert all(text.startswith(start) for text, start in zip(found, words, strict=True)), found


def test_statics_without_loads_are_told():
    with pytest.warns(rf.RigidfxWarning, match="nothing acts and nothing moves"):
        list(rf.static(beam(CLAMP), 2, verbose=False))
    list(rf.static(beam(CLAMP, load()), 2, verbose=False))


def test_a_motion_that_alternates_from_step_to_step_is_told():
    """The deflection of a beam is twice the static one, nothing, twice that, … ."""
    scene = beam(CLAMP, load())
    period = rf.periods(scene, 1)[0]
    *_, last = rf.static(scene, 1, verbose=False)
    static, dt = last.probes["tip"][2], 11 * period
    with pytest.warns(rf.RigidfxWarning, match="goes back and forth from step to step"):
        reports = list(rf.simulate(scene, dt, 6 * dt, progress=False, verbose=False))
    tip = np.array([report.probes["tip"][2] for report in reports])
    assert tip[1::2] == pytest.approx(2 * static, rel=0.1)
    assert abs(tip[::2]).max() < 0.1 * static
    assert told(scene, period / 4, 5 * period) == []
    slow = rf.Table((0.0, 50 * dt), (0.0, 1.0))
    assert told(beam(CLAMP, load(time=slow)), dt, 16 * dt) == []


def test_a_rigid_part_on_a_spring_alternates_too():
    scene = beam(rf.Rigid(), rf.Spring("x0", stiffness=1e6), rf.Spring("x1", stiffness=1e6), load())
    period = rf.periods(scene, 1)[0]
    assert any("goes back and forth" in text for text in told(scene, period, 9 * period))
    assert told(scene, period / 12, period) == []


def test_damping_ratios_above_the_critical_one_are_told():
    with pytest.warns(rf.RigidfxWarning, match="damping ratio 2 is above the critical one"):
        beam(CLAMP, rf.StiffnessDamping(2.0, 30.0))
    with pytest.warns(rf.RigidfxWarning, match="damping ratio 5 is above the critical one"):
        rf.rayleigh(10.0, 30.0, 5.0)
    beam(CLAMP, rf.StiffnessDamping(1.0, 30.0), *rf.rayleigh(10.0, 30.0, 0.02))


def test_millimetres_are_told_by_the_mass():
    with pytest.warns(rf.RigidfxWarning, match=r"its mass is 7.85e\+07 kg. Are lengths in milli"):
        beam(CLAMP, length=100.0)
    beam(CLAMP, length=10.0)


@pytest.mark.parametrize("face", [rf.MeanFace, rf.RigidFace])
def test_joints_far_from_their_faces_are_told(face):
    """The end of the beam is 0.1 m wide, 0.041 m by its nodes' distances from the middle."""

    def joined(x):
        return beam(rf.Spherical("ground", face("x1"), at=(x, 0.05, 0.05)))

    with pytest.warns(rf.RigidfxWarning, match=r"0.4 m away from the middle of"):
        joined(1.4)
    joined(1.2)
    beam(rf.PointMass(face("x1"), 10.0, at=(1.4, 0.05, 0.05))) if face is rf.MeanFace else None


@pytest.mark.parametrize("turn", [180.0, 270.0])
def test_large_turns_in_a_step_of_statics_speak_no_numpy(turn):
    """A trial may leave the numbers; its step is cut, and NumPy's warnings are errors here."""
    hinge = rf.Revolute("ground", rf.RigidFace("x0"), (0, 0.05, 0.05), (1, 0, 0), name="hinge")
    motor = rf.Motor("hinge", angle=lambda t: np.radians(turn) * t)
    scene = beam(hinge, motor, rf.Gravity())
    *_, last = rf.static(scene, 1, verbose=False)
    assert last.joints["hinge"].angle == pytest.approx(np.radians(turn), abs=1e-6)

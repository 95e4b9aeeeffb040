"""Scenes that can be computed and are hardly meant are told, and right ones beside them are not."""

import sys

import numpy as np
import pytest
from histories import heard

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
    with heard() as found:
        list(rf.simulate(scene, dt, t_end, progress=False, verbose=False, **how))
    return found


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
    with pytest.warns(rf.RigidfxWarning, match="NodalForce on 'x0': supports hold all nodes"):
        list(rf.static(beam(CLAMP, load(), load("x0")), 2, verbose=False))
    list(rf.static(beam(CLAMP, load()), 2, verbose=False))


@pytest.mark.parametrize("weighs", [True, False])
@pytest.mark.parametrize("rigid", [True, False])
def test_a_part_that_hangs_at_rest_is_no_scene_without_loads(rigid, weighs):
    """Its hinge bears the weight, without work; without one it moves by rounding."""
    side = "end" if rigid else rf.MeanFace("x0")
    hinge = rf.Revolute("ground", side, at=(0, 0.05, 0.05), axis=(0.6, 0.8, 0))
    weight = [rf.Gravity((9.81, 0, 0))] * weighs
    scene = beam(*[rf.Rigid("end")] * rigid, hinge, *weight)
    found = [*told(scene), *warnings_of(lambda: list(rf.static(scene, 1, verbose=False)))]
    assert sum("nothing acts and nothing moves" in text for text in found) == 2 * (not weighs)


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
    (few,) = told(scene, dt, 3 * dt)
    assert "goes back and forth from step to step" in few
    assert told(scene, period / 4, 0.75 * period) == told(scene, dt, 2 * dt) == []
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


@pytest.mark.parametrize(
    ("damping", "words"),
    [
        (lambda w: rf.MassDamping(2.2 * w), "damping ratio 1.09"),
        (lambda w: rf.MassDamping(1.8 * w), None),
        (lambda w: rf.KelvinVoigt(6 * 2.1e11 / w), "damping ratio 1."),
        (lambda w: rf.KelvinVoigt(2.1e11 / w), None),
        (lambda w: rf.StiffnessDamping(0.9, 0.5 * w / (2 * np.pi)), "damping ratio 1.8"),
        (lambda w: rf.NumericalDamping(0.5), None),
    ],
)
def test_damping_in_which_a_structure_does_not_vibrate_is_told(damping, words):
    """Its frequency is that of Rayleigh's quotient for the shape in the run."""
    period = rf.periods(beam(CLAMP, load()), 1)[0]
    found = told(beam(CLAMP, load(), damping(2 * np.pi / period)), period / 20, 1.5 * period)
    assert len(found) == (words is not None), found
    assert all(words in text for text in found), found


def test_a_damper_that_lets_nothing_swing_on_its_spring_is_told():
    spring = {"at_a": (2, 0, 0), "stiffness": 1e4}
    critical = 2 * np.sqrt(1e4 * 78.5)
    with pytest.warns(rf.RigidfxWarning, match="under all mass: the damping ratio 1.2 is above"):
        beam(CLAMP, rf.SpringDamper("ground", "x1", damping=1.2 * critical, **spring))
    beam(CLAMP, rf.SpringDamper("ground", "x1", damping=0.9 * critical, **spring))
    beam(CLAMP, rf.SpringDamper("ground", "x1", damping=1e6, at_a=(2, 0, 0)))


def warnings_of(make):
    """Warnings of making a scene."""
    with heard() as found:
        make()
    return found


@pytest.mark.parametrize(
    ("length", "effects", "words"),
    [
        (100.0, [CLAMP], ["its mass is 7.85e+07 kg. Are lengths in milli"]),
        (10.0, [CLAMP, load(value=(0, 0, 5.0))], ["forces of 5 N at most are next to nothing"]),
        (10.0, [CLAMP, load(value=(0, 0, 5.0)), rf.Gravity()], ["forces of 5 N at most"]),
        (10.0, [rf.Rigid(), rf.Spring("x0", 1e6), rf.Resultant(force=(0, 0, 5.0))], ["5 N at"]),
        (10.0, [CLAMP, rf.Gravity(), load()], []),
        (100.0, [CLAMP, load(value=(0, 0, 1e6))], []),  # a hall
        (1e-4, [CLAMP, load(value=(0, 0, 1e-9))], []),
        (10.0, [CLAMP, load(value=lambda t: (0, 0, t))], []),
        (10.0, [CLAMP], []),
    ],
)
def test_millimetres_are_told_by_the_mass_and_by_forces_beside_the_weight(length, effects, words):
    """A steel part of 10 mm weighs 0.077 N, and 77 MN if it is read in metres."""
    found = warnings_of(lambda: beam(*effects, length=length))
    assert len(found) == len(words), found
    assert all(part in text for text, part in zip(found, words, strict=True)), found


@pytest.mark.parametrize(
    ("length", "effect", "dt", "words"),
    [
        (10.0, rf.Gravity(), 2e-6, "a wave needs"),  # parts of 10 and 50 mm
        (50.0, rf.Pressure("z1", 1e5), 1e-5, "a wave needs"),
        (10.0, rf.PrescribedMotion("x1", displacement=lambda t: (0, 0, t * t)), 2e-6, "a wave"),
        (0.01, rf.Gravity(), 2e-6, None),
        (10.0, rf.Gravity(), 1e-4, None),
        (100.0, rf.PrescribedMotion("x1", displacement=lambda t: (0, 0, t * t)), 0.01, None),
    ],
)
def test_millimetres_are_told_by_short_steps(length, effect, dt, words):
    """A structure of 7.85e7 kg that is moved is not told of its mass; that was."""
    found = [
        text for text in told(beam(CLAMP, effect, length=length), dt, 2 * dt) if "mill" in text
    ]
    assert len(found) == (words is not None), found
    assert all(words in text for text in found)
    assert not warnings_of(lambda: beam(CLAMP, effect, length=length))


@pytest.mark.parametrize(
    ("E", "rho", "g", "told"),
    [
        (2.1e5, 7.85e-9, 9.81, True),  # t, mm, s
        (2.1e5, 7.85e-9, 9810.0, False),
        (210.0, 7.85e-6, 9.81, True),  # kg, mm, ms
        (210.0, 7.85e-6, 0.00981, False),
        (2.1e11, 7850.0, 9.81, False),
        (1e4, 1.0, 9.81, False),  # an aerogel
        (2.1e11, 7850.0, 9810.0, True),
    ],
)
def test_gravity_in_other_units_than_the_density_is_told(E, rho, g, told):
    material = rf.StVenantKirchhoff(E=E, nu=0.3, rho=rho)
    found = warnings_of(lambda: beam(CLAMP, rf.Gravity((0, 0, -g)), material=material))
    assert ["is in m/s²" in text for text in found] == told * [True]


def test_moduli_in_other_units_than_the_density_are_told():
    """Pa with t/mm³: waves would be faster than light."""
    material = rf.StVenantKirchhoff(E=2.1e11, nu=0.3, rho=7.85e-9)
    (words,) = warnings_of(lambda: beam(CLAMP, material=material))
    assert "faster than light" in words


def test_a_stop_in_degrees_is_told():
    hinge = rf.Revolute("ground", rf.MeanFace("x1"), at=(1, 0.05, 0.05), axis=(0, 1, 0), name="h")
    found = warnings_of(lambda: beam(CLAMP, hinge, rf.Stop("h", high=30.0, stiffness=1e3)))
    assert sum("np.radians" in words for words in found) == 1


@pytest.mark.parametrize("face", [rf.MeanFace("x1"), rf.RigidFace("x1"), "end"])
def test_places_far_from_their_sides_are_told(face):
    """The end of the beam is 0.1 m wide, 0.071 m by its nodes' distances from the middle.

    A joint is expected on its face, a remote point on an arm, and so is the joint of a part, which
    is 0.137 m large.
    """
    part, on_face = [rf.Rigid("end")] * (face == "end"), face != "end"

    def far(kind, x):
        return warnings_of(lambda: beam(*part, kind((x, 0.05, 0.05))))

    def joint(at):
        return rf.Spherical("ground", face, at=at)

    def tie(at):
        return rf.SpringDamper("ground", face, 1e3, at_a=(3, 1, 1), at_b=at)

    def mass(at):
        return rf.PointMass(face, 10.0, at=at)

    for kind, silent, loud in (
        (joint, 1.2 if on_face else 2.1, 1.4 if on_face else 2.3),
        (tie, 1.6 if on_face else 2.1, 1.8 if on_face else 2.3),
        *([(mass, 1.6, 1.8)] if on_face else []),
    ):
        assert far(kind, silent) == []
        (words,) = far(kind, loud)
        assert "m away from the middle of" in words
        assert "as on a rigid arm" in words


@pytest.mark.parametrize("turn", [180.0, 270.0])
def test_large_turns_in_a_step_of_statics_speak_no_numpy(turn):
    """A trial may leave the numbers; its step is cut, and NumPy's warnings are errors here."""
    hinge = rf.Revolute("ground", rf.RigidFace("x0"), (0, 0.05, 0.05), (1, 0, 0), name="hinge")
    motor = rf.Motor("hinge", angle=lambda t: np.radians(turn) * t)
    scene = beam(hinge, motor, rf.Gravity())
    *_, last = rf.static(scene, 1, verbose=False)
    assert last.joints["hinge"].angle == pytest.approx(np.radians(turn), abs=1e-6)


def sine(steps):
    """A force of so many steps a period, of steps of 0.1 ms."""
    return lambda t: (0.0, 0.0, 1e3 * np.sin(2 * np.pi * t / (steps * 1e-4)))


SHAKEN = rf.PrescribedMotion("x0", displacement=lambda t: (0, 0, 1e-4 * (1 - np.cos(5e4 * t))))
WAVE = rf.Traction("z1", lambda x, t: np.outer((0, 0, 1.0), np.sin(3 * x[0] - 1e5 * t)))
PULSE = rf.Table((0.0, 1e-5, 2e-5), (0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("load", "dt"),
    [
        (load(value=sine(4)), 3.9e-5),
        (load(value=sine(1.3)), 1.3e-5),
        (load(value=sine(0.25)), 2.5e-6),  # it is zero at middles, and in means
        (
            load(value=lambda t: 1e3 * np.exp(-(((t - 3e-4) / 3e-5) ** 2)) * np.ones(3)),
            1.88e-5,
        ),  # 2π 30 µs
        (rf.Pressure("z1", lambda t: 1e5 * np.cos(2e5 * t)), 3.1e-6),
        (WAVE, 6.2e-6),
        (SHAKEN, 1.2e-5),
        (load(value=sine(6)), None),
        (load(value=lambda t: (0, 0, 1e3 * (t > 2.7e-4))), None),  # one jump in 40 steps
        (load(time=PULSE), None),
    ],
)
def test_loads_that_steps_do_not_resolve_are_told(load, dt):
    """With a tenth of their period, at which nothing is told."""
    held = [CLAMP] if load is not SHAKEN else []
    found = [text for text in told(beam(*held, load), t_end=4e-3) if "changes faster" in text]
    assert len(found) == (dt is not None), found
    if dt is not None:
        assert found[0].startswith(load.owner)
        wanted = float(found[0].split("Δt ≤ ")[1].split()[0])
        assert wanted == pytest.approx(dt, rel=0.1)
        found = told(beam(*held, load), dt=wanted, t_end=40 * wanted)
        assert not [text for text in found if "changes faster" in text]


@pytest.mark.parametrize(
    ("by", "given", "words"),
    [
        ("torque", lambda t: 100 * np.sin(5e4 * t), "value"),
        ("speed", lambda t: 0.1 * np.sin(5e4 * t), "velocity"),
        ("angle", lambda t: 1e-4 * (1 - np.cos(5e4 * t)), "velocity"),
        ("angle", lambda t: 1e-2 * (1 - np.cos(5e2 * t)), None),
        ("angle", lambda t: 0.0, None),
        ("torque", rf.Table((0, 1e-5, 3e-5), (0, 1, 0)), None),
    ],
)
def test_motors_that_steps_do_not_resolve_are_told(by, given, words):
    pin = rf.Revolute("ground", rf.RigidFace("x0"), (0, 0.05, 0.05), (0, 1, 0), name="pin")
    found = told(beam(pin, rf.Motor("pin", **{by: given}), load()), t_end=2e-3)
    found = [text for text in found if "changes faster" in text]
    assert len(found) == (words is not None), found
    for text in found:
        assert text.startswith(f"Motor of 'pin': its {words} changes faster")
        assert float(text.split("Δt ≤ ")[1].split()[0]) == pytest.approx(1.25e-5, rel=0.1)


def test_a_step_control_is_not_told_of_fast_loads():
    control = rf.StepControl(0.1, largest=1e-4)
    found = told(beam(CLAMP, load(value=sine(4))), control, t_end=1e-3)
    assert not [text for text in found if "changes faster" in text]


LATER = {"since": 1e5}


def bar(*effects):
    """A bar that is pushed, maybe with a rigid half."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_cells("half", lambda X: X[0] >= 2 - 1e-9)
    steel = rf.StVenantKirchhoff(E=2e7, nu=0.3, rho=1000.0)
    push = rf.Traction("x1", (0, 0, 2e3))
    return rf.Scene(domain, steel, [rf.Fixed("x0"), push, *effects])


IDLE = [
    rf.Gravity(**LATER),
    rf.BodyForce((1.0, 0, 0), **LATER),
    rf.Traction("y0", (1.0, 0, 0), **LATER),
    rf.NodalForce("y1", (1.0, 0, 0), **LATER),
    rf.Pressure("z0", 1.0, **LATER),
    rf.Pressure("z1", 2.0, **LATER),
    rf.KelvinVoigt(1.0, **LATER),
    rf.MassDamping(0.1, **LATER),
    rf.NumericalDamping(0.1, **LATER),
    rf.PrescribedMotion("x1", displacement=lambda t: (0.0, 0.0, 0.0), **LATER),
]


def calls(scene, steps=4):
    """Calls of Python and of C in a run's steps, as the interpreter counts them, and iterations."""
    run = rf.simulate(scene, 0.01, 2e5)
    for _ in range(3):
        next(run)
    count = 0

    def note(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        iterations = [next(run).iterations for _ in range(steps)]
    finally:
        sys.setprofile(before)
    run.close()
    return count, iterations


@pytest.mark.parametrize("rigid", [(), (rf.Rigid("half"),)], ids=["flexible", "rigid"])
def test_ten_effects_that_do_not_act_cost_nothing(rigid):
    # The interpreter's own calls, of collected objects say, come now and then.
    without, beside = (min(calls(bar(*rigid, *idle)) for _ in range(3)) for idle in ((), IDLE))
    assert without == beside
    assert without[0] > 1000

"""Motions and loads by place, rotations, symmetry, damping, preloads; velocities of paths."""

from itertools import pairwise

import numpy as np
import pytest
from parallel import report as tell
from parallel import run as mpirun
from scipy.optimize import curve_fit

import rigidfx as rf

PI = np.pi
T_END = 1.0


def scene_of(x, v, components="xyz", others=(0.0, 0.0), **window):
    """A cube whose end follows a path along x."""
    path = x if isinstance(x, rf.Table) else (lambda t: x(t))

    def displacement(t):
        return (path(t), 0.0, 0.0)

    displacement.breakpoints = getattr(x, "breakpoints", ())
    motion = rf.PrescribedMotion(
        "x0",
        components,
        displacement=displacement,
        velocity=lambda t: (v(t), *others),
        **window,
    )
    material = rf.StVenantKirchhoff(E=1e3, nu=0.0, rho=10.0)
    return rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), material, [motion])


def check(scene, t_end=T_END):
    """What a run asks of the scene's supports before its first step."""
    for support, _ in scene.supports:
        support.check_run(scene, t_end)


def eased(t):
    s = min(t / 0.5, 1.0)
    return 0.1 * (3 * s**2 - 2 * s**3)


def eased_speed(t):
    s = min(t / 0.5, 1.0)
    return 0.1 * (6 * s - 6 * s**2) / 0.5


def fifth(t):
    s = min(t / 0.5, 1.0)
    return 0.1 * (10 * s**3 - 15 * s**4 + 6 * s**5)


def fifth_speed(t):
    s = min(t / 0.5, 1.0)
    return 0.1 * (30 * s**2 - 60 * s**3 + 30 * s**4) / 0.5


def late(t):
    """Not defined before its window, nor long after it."""
    assert 0.2 <= t <= 0.6
    return 0.1 * (t - 0.2) ** 2


def late_speed(t):
    assert 0.2 <= t <= 0.6
    return 0.2 * (t - 0.2)


TABLE = rf.Table((0.0, 0.31, 0.62, 1.0), (0.0, 0.1, -0.1, 0.0))
SLOPES = 0.1 / 0.31, -0.2 / 0.31, 0.1 / 0.38, 0.0


def slope(t):
    return SLOPES[min(np.searchsorted(TABLE.times, t, side="right") - 1, 3)]


POLYGON = np.linspace(0.0, 1.0, 41)
W = 2 * PI * 3e4
SOUND = {  # path, velocity, window
    "cube": (lambda t: t**3, lambda t: 3 * t**2, {}),
    "smoothstep": (eased, eased_speed, {}),
    "smoothstep of order 5": (fifth, fifth_speed, {}),
    "square of a sine": (lambda t: 0.1 * np.sin(20 * t) ** 2, lambda t: 2 * np.sin(40 * t), {}),
    "cosine": (lambda t: 0.01 * (1 - np.cos(20 * t)), lambda t: 0.2 * np.sin(20 * t), {}),
    "sine": (lambda t: 0.05 * np.sin(7 * t), lambda t: 0.35 * np.cos(7 * t), {}),
    "fast": (lambda t: 1e-6 * np.sin(W * t), lambda t: 1e-6 * W * np.cos(W * t), {}),
    "fast from its top": (lambda t: 1e-6 * np.cos(W * t), lambda t: -1e-6 * W * np.sin(W * t), {}),
    "slow": (lambda t: np.sin(1e-3 * t), lambda t: 1e-3 * np.cos(1e-3 * t), {}),
    "far away": (lambda t: 1e6 + 0.05 * np.sin(7 * t), lambda t: 0.35 * np.cos(7 * t), {}),
    "rest": (lambda t: 3.0, lambda t: 0.0, {}),
    "table": (TABLE, slope, {}),
    "kink without a name": (lambda t: max(t - 0.4, 0.0), lambda t: 1.0 * (t > 0.4), {}),
    "saw without names": (
        lambda t: abs((t % 0.2) - 0.1),
        lambda t: 1.0 - 2.0 * (t % 0.2 < 0.1),
        {},
    ),
    "defined in its window only": (late, late_speed, {"since": 0.2, "until": 0.6}),
    "polygon of a curve": (
        lambda t: np.interp(t, POLYGON, np.sin(POLYGON)),
        np.cos,
        {},
    ),
    "stairs": (lambda t: 0.1 * np.floor(t / 0.17), lambda t: 0.0, {}),
}


@pytest.mark.parametrize("name", SOUND)
@pytest.mark.parametrize("t_end", [T_END, 0.013])
def test_a_velocity_that_is_right_is_taken(name, t_end):
    path, velocity, window = SOUND[name]
    check(scene_of(path, velocity, **window), t_end)


def test_components_that_are_not_held_do_not_count():
    check(scene_of(lambda t: t**3, lambda t: 3 * t**2, "xz", others=(7.0, 0.0)))
    with pytest.raises(rf.SceneError, match=r"m/s along y, z, and its path"):
        scene_of(lambda t: t**3, lambda t: 9.0, "yz", others=(7.0, 0.0))


def round_trip(t):
    return 0.01 * (1 - np.cos(2 * PI * t))


WRONG = {  # right at t = 0
    "none at all": (round_trip, lambda t: 0.0),
    "without its factor": (round_trip, lambda t: 0.01 * np.sin(2 * PI * t)),
    "sign": (round_trip, lambda t: -0.02 * PI * np.sin(2 * PI * t)),
    "a hundred times": (round_trip, lambda t: 2 * PI * np.sin(2 * PI * t)),
    "none of a fast path": (lambda t: 1e-6 * (1 - np.cos(W * t)), lambda t: 0.0),
    "of the first part only": (lambda t: max(0.1, t), lambda t: 0.0),
    "between kinks": (TABLE, lambda t: slope(t) * (1 + np.sin(PI * t / 0.31) ** 2)),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_velocity_that_is_wrong_later_is_refused(name):
    scene = scene_of(*WRONG[name])
    with pytest.raises(rf.SceneError, match=r"its velocity is .* and its path moves by"):
        rf.simulate(scene, 0.1, T_END)


# Paths that begin at full speed.
pytestmark = pytest.mark.filterwarnings("ignore:.* acts with a jolt")

MATERIAL = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=10.0)


def cube(cell="hexahedron"):
    return rf.box((0, 0, 0), (1, 1, 1), (2, 2, 2), cell)


def worst_balance(scene, dt, t_end, **how):
    """Largest error of ΔH = work of loads and supports less what is dissipated, and all reports."""
    reports = list(rf.simulate(scene, dt, t_end, progress=False, **how))
    off = [abs(b.energy - a.energy - b.supplied) for a, b in pairwise(reports)]
    return max(off), reports


def spun_up(t):
    return 1.5 * t**2  # rad


def rotor(rigid=False):
    """A disc of a hub and a rim: the hub is run up to 6 rad/s in 2 s."""
    domain = rf.box((-2, -2, 0), (2, 2, 0.5), (4, 4, 1))
    domain = domain.with_cells("hub", lambda x: np.abs(x[:2]).max(axis=0) < 1.01)
    drive = rf.PrescribedRotation("hub", axis=(0, 0, 2), angle=spun_up, speed=lambda t: 3.0 * t)
    effects = [drive, *([rf.Rigid("hub")] if rigid else [])]
    return rf.Scene(domain, MATERIAL, effects, probes={"rim": (2, 0, 0.25), "hub": (1, 0, 0.25)})


@pytest.mark.parametrize("rigid", [False, True])
def test_rotor_is_run_up_by_its_hub(rigid):
    """Energy balances with the support's work to 1e-12; the hub turns as told, the rim follows."""
    worst, reports = worst_balance(rotor(rigid), 0.02, 1.0)
    last = reports[-1]
    assert worst < 1e-12 * last.energy
    angle = spun_up(1.0)
    np.testing.assert_allclose(
        last.probes["hub"] + (1, 0, 0), (np.cos(angle), np.sin(angle), 0), atol=1e-13
    )
    rim = last.probes["rim"] + (2, 0, 0)
    assert 2.0 < np.linalg.norm(rim[:2]) < 2.1  # the centrifugal force stretches it
    push = [0.02 * r.reaction_moments["hub"][2] + r.angular_impulse[2] for r in reports[1:]]
    moments = [r.angular_momentum[2] for r in reports]
    np.testing.assert_allclose(np.diff(moments), push, atol=1e-9 * moments[-1])
    work = sum(r.work_of_supports for r in reports)
    assert work == pytest.approx(last.energy - reports[0].energy, rel=1e-11)


def sheared(x, t):
    return np.array([0.2 * t * x[2], 0 * x[0], 0 * x[0]])


def test_prescribed_motion_of_place():
    """A shear of all faces of a cube makes it homogeneous; its work is the energy."""
    faces = ("x0", "x1", "y0", "y1", "z0", "z1")
    motion = {"displacement": sheared, "velocity": lambda x, t: sheared(x, 1.0)}
    effects = [rf.PrescribedMotion(name, **motion) for name in faces]
    scene = rf.Scene(cube(), MATERIAL, effects, probes={"middle": (0.5, 0.5, 0.5)})
    worst, reports = worst_balance(scene, 0.05, 1.0)
    assert worst < 1e-11 * reports[-1].energy
    for report in reports:
        # The one free node is pulled along by its neighbours.
        assert abs(report.probes["middle"][0] - 0.1 * report.t) < 0.02
    assert reports[-1].probes["middle"][0] == pytest.approx(0.1, abs=0.02)


def test_initial_velocity_has_to_fit_a_motion_of_place():
    motion = rf.PrescribedMotion("z1", displacement=sheared)
    fits = rf.InitialVelocity(function=lambda x: sheared(x, 1.0))
    scene = rf.Scene(cube(), MATERIAL, [motion, fits])
    next(rf.simulate(scene, 0.1, 0.1, progress=False))
    scene = rf.Scene(cube(), MATERIAL, [motion, rf.InitialVelocity(linear=(1, 0, 0))])
    with pytest.raises(rf.SceneError, match="contradicts PrescribedMotion on 'z1'"):
        next(rf.simulate(scene, 0.1, 0.1, progress=False))


@pytest.mark.parametrize("rigid", [False, True])
def test_traction_of_place(rigid):
    """Force, torque and work of a traction that grows along the surface, of bodies too."""
    load = rf.Traction("z1", lambda x, t: np.stack([0 * x[0], 0 * x[0], 6 * t * x[0]]))
    effects = [load, *([rf.Rigid("all")] if rigid else [])]
    domain = cube().with_cells("all", lambda x: x[0] > -1)
    worst, reports = worst_balance(rf.Scene(domain, MATERIAL, effects), 0.02, 0.4)
    assert worst < 1e-11 * reports[-1].energy
    for report in reports:
        L, J = report.linear_momentum, report.angular_momentum
        assert L[2] == pytest.approx(1.5 * report.t**2, rel=1e-9)  # ∫ 6 t x dA dt
        assert abs(L[0]) + abs(L[1]) < 1e-9
    # About the origin ∫ -x · 6 t x dA; nodal values of x times areas overestimate ∫ x² by 1/24.
    assert J[1] == pytest.approx(-3 * (1 / 3 + 1 / 24) * 0.4**2, rel=0.01)


def test_total_traction_of_place():
    """Its force is the mean of the function over the area, on which it is spread."""
    domain = rf.box((0, 0, 0), (2, 3, 2), (1, 2, 2))
    pull = rf.Traction("x1", lambda x, t: np.stack([x[1], 0 * x[1], 1 + 0 * x[1]]), total=True)
    scene = rf.Scene(domain, MATERIAL, [rf.Fixed("x0"), pull, rf.Preload([pull])])
    first = next(rf.simulate(scene, 0.1, 0.1, progress=False))
    np.testing.assert_allclose(first.reactions["x0"], (-1.5, 0, -1), atol=1e-8)


def test_initial_displacement_is_let_go():
    """Energy is there from the start and stays; a support holds what it displaced."""
    start = rf.InitialDisplacement(lambda x: np.array([0.1 * x[2], 0 * x[0], 0 * x[0]]))
    scene = rf.Scene(cube(), MATERIAL, [start, rf.Fixed("z0")], probes={"top": (0.5, 0.5, 1)})
    worst, reports = worst_balance(scene, 0.01, 0.1)
    C = np.eye(3) + 0.1 * np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0.1]])
    E, p = (C - np.eye(3)) / 2, MATERIAL.parameters
    W = p["lmbda"] / 2 * np.trace(E) ** 2 + p["mu"] * (E * E).sum()
    assert reports[0].energy == pytest.approx(W, rel=1e-12)
    np.testing.assert_allclose(reports[0].probes["top"], (0.1, 0, 0), atol=1e-15)
    assert worst < 1e-11 * W
    assert reports[-1].probes["top"][0] < 0.09


@pytest.mark.parametrize("face", ["x0", "y1", "z0"])
def test_symmetry_holds_the_normal(face):
    (effect,) = rf.Scene(cube(), MATERIAL, [rf.Symmetry(face)]).effects
    assert effect.components == face[0]


def test_half_a_bar_moves_as_a_whole_one():
    """By symmetry, to the end of Newton's iteration."""
    ends = []
    for low, cells in ((-1.0, 4), (0.0, 2)):
        bar = rf.box((low, 0, 0), (1, 1, 3), (cells, 1, 6))
        half = [rf.Symmetry("x0")] if low == 0 else []
        load = rf.Traction("z1", lambda x, t: np.stack([30 * x[0], 300 + 0 * x[0], 0 * x[0]]))
        scene = rf.Scene(bar, MATERIAL, [rf.Fixed("z0"), load, *half], probes={"end": (1, 1, 3)})
        *_, last = rf.simulate(scene, 0.01, 0.05, progress=False)
        ends.append(last.probes["end"])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-10 * np.abs(ends[0]).max())


@pytest.mark.parametrize("material", [MATERIAL, rf.NeoHooke(E=1e5, nu=0.3, rho=10.0)])
def test_damping_has_its_ratio_at_its_frequency(material):
    """A bar stretched by 1e-4 rings down by exp(-ζ ω t); what is lost is reported."""
    bar = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    loose = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("z0", "z")]
    pull = rf.InitialDisplacement(
        lambda x: np.stack([4e-4 * np.sin(np.pi * x[0] / 8), 0 * x[0], 0 * x[0]])
    )
    wide = [rf.Fixed(f, c) for f, c in (("y1", "y"), ("z1", "z"))]
    frequency = np.sqrt(1e5 * 0.7 / (1.3 * 0.4) / 10.0) / 16  # of a bar kept from growing thinner
    ratio = 0.05
    effects = [*loose, *wide, pull, rf.StiffnessDamping(ratio, frequency)]
    scene = rf.Scene(bar, material, effects, probes={"end": (4, 0.5, 0.5)}, mass="consistent")
    worst, reports = worst_balance(scene, 0.02 / frequency, 4 / frequency)
    # A hyperelastic energy is known to ε E V.
    assert worst < 1e-9 * reports[0].energy + 2.3e-16 * 1e5 * 4.0
    t, u = np.array([(r.t, r.probes["end"][0]) for r in reports]).T

    def ring(t, a, decay, omega, phase):
        return a * np.exp(-decay * t) * np.cos(omega * t + phase)

    (_, decay, omega, _), _ = curve_fit(ring, t, u, (4e-4, 0.3, 2 * np.pi * frequency, 0))
    assert omega == pytest.approx(2 * np.pi * frequency, rel=0.02)
    assert decay / omega == pytest.approx(ratio, rel=0.03)
    lost = sum(r.dissipated.get("StiffnessDamping", 0.0) for r in reports)
    gone = reports[0].energy - reports[-1].energy
    assert lost == pytest.approx(gone, rel=1e-9, abs=2.3e-16 * 1e5 * 4.0)


def test_reactions_of_a_preload():
    """What supports carry before anything moves: force, and moment about the deformed place."""
    load = rf.Traction("z1", (0, 20.0, -50.0))
    scene = rf.Scene(cube(), MATERIAL, [rf.Fixed("z0"), rf.Preload([load])])
    first = next(rf.simulate(scene, 0.1, 0.1, progress=False))
    np.testing.assert_allclose(first.reactions["z0"], (0, -20, 50), atol=1e-8)
    assert first.reaction_moments["z0"][0] == pytest.approx(25 + 20, rel=0.02)


def on_ranks():
    """A short run with everything that depends on the place."""
    domain = rf.box((0, 0, 0), (1, 1, 3), (2, 2, 6)).with_cells("top", lambda x: x[2] > 1.99)
    effects = [
        rf.PrescribedRotation("z0", axis=(0, 0, 1), through=(0.5, 0.5, 0), angle=spun_up),
        rf.Traction("x1", lambda x, t: np.stack([100 * x[2] * t, 0 * x[0], 0 * x[0]])),
        rf.StiffnessDamping(0.1, 5.0),
        rf.Rigid("top"),
    ]
    scene = rf.Scene(domain, MATERIAL, effects, probes={"end": (1, 1, 3)})
    *_, last = rf.simulate(scene, 0.02, 0.2, progress=False)
    return [last.energy, *last.probes["end"], *last.reactions["z0"], last.work_of_supports]


@pytest.mark.parallel
def test_fields_on_several_ranks():
    np.testing.assert_allclose(mpirun(__file__, 3, 120), on_ranks(), rtol=1e-7)


if __name__ == "__main__":
    found = on_ranks()
    tell([float(x) for x in found])

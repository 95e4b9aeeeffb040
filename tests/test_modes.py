"""Modes and periods of small vibrations: beams, bodies on springs, stresses, several ranks."""

from itertools import pairwise

import numpy as np
import pytest
from bench.mechanism_scenes import Link, linked
from bench.mode_answers import hinged_bar
from common import boxes
from parallel import report as tell
from parallel import run as mpirun
from scipy.linalg import eigh

import rigidfx as rf
from rigidfx.linear.eigenpairs import EigenControl, lowest
from rigidfx.vibration import modes as module
from rigidfx.vibration.problem import Problem

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.0, rho=8000.0)
LONG, WIDE, HIGH = 1.0, 0.1, 0.05


def beam(*effects, n=(20, 2, 2), **how):
    domain = rf.box((0, 0, 0), (LONG, WIDE, HIGH), n)
    domain = domain.with_cells("end", lambda x: x[0] > 0.8 * LONG - 1e-9)
    return rf.Scene(domain, STEEL, effects, **how)


def bending(number, thickness, long=LONG):
    """T of Bernoulli's beam of rectangular section [s]."""
    omega = (number / long) ** 2 * thickness * np.sqrt(2e11 / 8000.0 / 12)
    return 2 * np.pi / omega


@pytest.mark.parametrize(
    "how",
    [
        {"order": 2},
        {"order": 2, "mass": "consistent"},
        {"element": "enhanced", "n": (20, 4, 2)},
    ],
)
def test_cantilever(how):
    """Shear makes it slower than Bernoulli's, by 0.2 to 0.8 %."""
    found = rf.periods(beam(rf.Fixed("x0"), **how), 2)
    exact = [bending(1.875104, HIGH), bending(1.875104, WIDE)]
    assert np.all(found > exact)
    np.testing.assert_allclose(found, exact, rtol=0.008)


def test_free_beam_has_no_period_of_rigid_motions():
    found = rf.periods(beam(order=2), 1)
    np.testing.assert_allclose(found, bending(4.730041, HIGH), rtol=0.01)


def block(*effects, E=1e6, n=2):
    return rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (n,) * 3),
        rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0),
        effects,
    )


def test_rigid_block_on_springs():
    """Vertically √(m/k); nothing is left of a block without springs, nor a mode of none."""
    springs = rf.Spring("z0", (1e4, 2e4, 4e4))
    found = rf.periods(block(springs, rf.Rigid()), 9)
    assert found.size == 6
    assert np.abs(found - 2 * np.pi * np.sqrt(1000.0 / 4e4)).min() < 1e-7
    np.testing.assert_allclose(rf.periods(block(springs, E=1e12), 6), found, rtol=1e-6)
    assert rf.periods(block(rf.Rigid())).size == 0
    upright = rf.modes(block(rf.Spring("x0", (0.0, 0.0, 4e4)), rf.Rigid()), 6)
    assert (upright.rigid, len(upright)) == (4, 2)


@pytest.mark.parametrize(
    ("part", "n", "count"), [("block", 1, 1), ("face", 1, 19), ("face", 4, None)]
)
def test_as_many_modes_as_unknowns_less_rows(part, n, count):
    """A joint adds none: a slider with a spring of 1 MN/m has one, of 5.033 Hz."""
    domain = rf.box((0, 0, 0), (1, 1, 1), (n,) * 3).with_cells("block", lambda x: x[0] > -1)
    side = part if part == "block" else rf.MeanFace("x0")
    slide = rf.Prismatic("ground", side, at=(0, 0.5, 0.5), axis=(1, 0, 0), name="slide")
    spring = rf.JointSpring("slide", 1e6)
    rigid = [rf.Rigid("block")] if part == "block" else []
    material = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=1000.0)
    scene = rf.Scene(domain, material, [slide, spring, *rigid])
    found = rf.modes(scene, 24 if count else 3)
    np.testing.assert_allclose(found.frequencies[0], np.sqrt(1e6 / 1e3) / (2 * np.pi), rtol=5e-6)
    assert count is None or (len(found), found.rigid) == (count, 0)
    assert count is None or rf.periods(scene, 24).size == count
    free = rf.modes(rf.Scene(domain, material, [slide, *rigid]), 24 if count else 3)
    assert free.rigid == 1
    assert count is None or len(free) == count - 1


def test_rigid_part_is_as_a_stiff_one():
    """At the end of a cantilever; clamped, it shortens it.

    What a stiff part still gives is inversely proportional to its stiffness, so two of them tell
    its limit; to come nearer by one takes a stiffness whose rounding is as large as what it gives.
    """
    rigid = rf.periods(beam(rf.Fixed("x0"), rf.Rigid("end"), order=2), 2)
    domain = beam().domain.with_cells("rest", lambda x: x[0] < 0.8 * LONG + 1e-9)

    def twin(E):
        stiff = {"end": rf.StVenantKirchhoff(E=E, nu=0.0, rho=8000.0), "rest": STEEL}
        return rf.periods(rf.Scene(domain, stiff, [rf.Fixed("x0")], order=2), 2)

    np.testing.assert_allclose(rigid, (10 * twin(2e13) - twin(2e12)) / 9, rtol=2e-7)
    short = rf.periods(beam(rf.Fixed("end"), rf.Rigid("end"), order=2), 1)
    np.testing.assert_allclose(short, bending(1.875104, HIGH, 0.8 * LONG), rtol=0.01)


def cube():
    """A free cube, all of whose first periods but one in five are as those of a twin mode."""
    return rf.periods(block(n=6), 10)


def test_equal_periods_come_as_often_as_they_are():
    found, problem = cube(), Problem(block(n=6))
    every = lowest(problem.K, problem.M, 10, control=EigenControl(dense=10**6))
    assert every.rigid == 6
    np.testing.assert_allclose(found, 2 * np.pi / np.sqrt(every.values[:10]), rtol=1e-8)
    problem.destroy()
    np.testing.assert_allclose(found[[0, 2, 3, 5, 6]], found[[1, 3, 4, 6, 7]], rtol=1e-7)


@pytest.mark.parallel
def test_ranks_find_the_same():
    """To 1e-8, with the shapes of a cantilever and of a cube's equal modes."""
    np.testing.assert_allclose(mpirun(__file__, 3, 300), on_ranks(), rtol=1e-8, atol=1e-8)


def on_ranks():
    """Periods, and the shapes of a square bar and a cube, at all nodes in order of their places."""
    cantilever = beam(rf.Fixed("x0"), rf.Rigid("end"), order=2)
    springs = rf.Spring("z0", (1e4, 2e4, 4e4))
    found = [*rf.periods(cantilever), *rf.periods(block(springs, rf.Rigid()))]
    shaped = rf.modes(block(n=6), 10)
    bent = rf.modes(cantilever, 3)
    shares = [np.abs(m.participation[:, :3]).reshape(-1) / np.sqrt(m.mass) for m in (shaped, bent)]
    shapes = _in_order(bent), _in_order(shaped)
    return [*found, *shaped.periods, *np.concatenate([*shares, *shapes])]


def _in_order(modes):
    """Shapes over their largest displacement, sorted by places, on rank 0."""
    scene, n = modes.scene, modes.scene.owned_nodes
    X = scene.space.tabulate_dof_coordinates()[:n].round(6)
    rows = np.concatenate([X, modes.shapes[:, :n].transpose(1, 0, 2).reshape(n, -1)], axis=1)
    every = scene.comm.gather(rows)
    if every is None:
        return np.empty(0)
    rows = np.concatenate(every)
    rows = rows[np.lexsort(rows[:, :3].T)][:, 3:].reshape(len(rows), len(modes), 3)
    return (rows / np.abs(rows).max(axis=(0, 2))[:, None]).reshape(-1)


def test_effective_masses_add_up():
    """Those of all modes are the mass that no support holds; of a bar's first, 0.613 of it."""
    scene = block(rf.Spring("z0", (1e4, 2e4, 4e4)), rf.Rigid())
    found = rf.modes(scene, 6)
    np.testing.assert_allclose(found.effective_mass.sum(axis=0), 1000.0, rtol=1e-10)
    given = rf.modes(block(rf.Spring("z0", (1e4, 2e4, 4e4)), rf.Rigid(mass=30.0)), 6)
    np.testing.assert_allclose([*given.effective_mass.sum(axis=0), given.mass], 30.0, rtol=1e-10)
    bent = rf.modes(beam(rf.Fixed("x0"), order=2), 1)
    assert abs(bent.effective_mass[0, 2] / bent.mass - 0.6131) < 0.003


def test_shapes_are_those_of_an_orthonormal_basis():
    """With a rigid end, whose nodes move as one body; equal modes are aligned with the axes."""
    domain = rf.box((0, 0, 0), (1.0, 0.1, 0.1), (20, 2, 2))
    domain = domain.with_cells("end", lambda x: x[0] > 0.8 - 1e-9)
    scene = rf.Scene(domain, STEEL, [rf.Fixed("x0"), rf.Rigid("end")])
    found = rf.modes(scene, 2)
    assert np.ptp(found.squares) < 1e-8 * found.squares[0]
    m = scene.nodal_mass[:, None]
    gram = np.einsum("ina,jna->ij", found.shapes * m, found.shapes)
    np.testing.assert_allclose(gram, np.eye(2), atol=2e-9)
    sizes = np.abs(found.participation[:, 1:3])
    assert sizes.min() < 1e-5 * sizes.max()
    nodes = scene.nodes("end", "test")
    X, u = scene.space.tabulate_dof_coordinates()[nodes], found.shapes[0][nodes]
    W, left, *_ = np.linalg.lstsq(X - X.mean(axis=0), u - u.mean(axis=0))
    assert np.abs(W + W.T).max() < 1e-10 * np.abs(W).max()
    assert left.max() < 1e-20


def test_stresses_stiffen():
    """A pulled bar with hinged ends: ω² = (π/L)⁴ EI/μ + (π/L)² N/μ."""
    (free, without), (pulled, exact) = (np.square(hinged_bar(pull, 40)) for pull in (0.0, 50.0))
    np.testing.assert_allclose(pulled - free, exact - without, rtol=2e-3)
    np.testing.assert_allclose(free, without, rtol=2e-3)


def test_a_rigid_bob_on_a_pulled_string_swings():
    """A pendulum: nothing but the pull of its weight holds it sideways."""
    long, thick, heavy, g = 1.0, 0.01, 20.0, 10.0
    domain = rf.box((0, 0, -long), (thick, thick, 0), (1, 1, 40))
    domain = domain.with_cells("bob", lambda x: x[2] < -0.975 + 1e-9)
    weight = rf.Traction("z0", (0.0, 0.0, -heavy * g / thick**2))
    mass = rf.PointMass("z0", heavy)
    soft = rf.StVenantKirchhoff(E=1e8, nu=0.0, rho=1.0)
    hangs = rf.Scene(domain, soft, [rf.Fixed("z1"), mass, rf.Preload([weight])])
    report = next(iter(rf.simulate(hangs, 1e-3, 1e-2)))
    swings = rf.Scene(domain, soft, [rf.Fixed("z1"), mass, weight, rf.Rigid("bob")])
    both = [rf.modes(s, 2, about=report).squares[0] for s in (hangs, swings)]
    stretch = 1 + heavy * g / (thick**2 * 1e8)
    bend = 3 * 1e8 * thick**4 / 12 / heavy
    np.testing.assert_allclose(both, g / (long * stretch) + bend, rtol=0.05)
    np.testing.assert_allclose(both[0], both[1], rtol=5e-3)


def chain(count, joint, *effects, along=(0.0, 0.0, -1.0), pull=(0.0, 0.0, -9.81)):
    """Rigid links of 1 m, the first one hung on the ground, under gravity."""
    ends = [k * np.array(along) for k in range(count + 1)]
    links = [
        Link(f"link {k}", *pair, cells=2, wide=0.05, gap=0.0)
        for k, pair in enumerate(pairwise(ends))
    ]
    names, joints = ["ground", *(link.name for link in links)], []
    for a, b, at in zip(names, names[1:], ends, strict=False):
        joints += [joint(a, b, tuple(at)), rf.Rigid(b)]
    stiff = rf.StVenantKirchhoff(E=2e11, nu=0.0, rho=1000.0)
    return rf.Scene(linked(links), stiff, [*joints, rf.Gravity(pull), *effects])


def hinge(a, b, at):
    return rf.Revolute(a, b, at=at, axis=(0, 1, 0))


def swinging(count):
    """f of rigid links with thirds of mass as 1, 2, 1 along them, small angles [Hz]."""
    M, K, own = np.zeros((count,) * 2), np.zeros((count,) * 2), 0.5**2 / 2 + 0.05**2
    for k in range(count):
        arms = np.r_[np.ones(k), 0.5, np.zeros(count - k - 1)]
        M += np.outer(arms, arms) + own * np.diag(np.arange(count) == k)
        K += 9.81 * np.diag(arms)
    return np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)


@pytest.mark.parametrize("count", [1, 3])
def test_rigid_links_swing_under_their_weight(count):
    """Forces of joints, and moments of weights, are all their stiffness; balls let them turn."""
    found = rf.modes(chain(count, hinge), 6)
    np.testing.assert_allclose(found.frequencies, swinging(count), rtol=1e-9)
    balls = rf.modes(chain(count, rf.Spherical), 3 * count)
    assert (len(balls), balls.rigid) == (2 * count, count)
    np.testing.assert_allclose(balls.frequencies[::2], swinging(count), rtol=1e-9)
    with pytest.warns(UserWarning, match=f"reference is unstable: {count} of the modes grow"):
        upright = rf.modes(chain(count, hinge, pull=(0, 0, 9.81)), 6)
    np.testing.assert_allclose(upright.squares[::-1], -found.squares, rtol=1e-9)
    aside = rf.modes(chain(count, hinge, pull=(9.81, 0, 0)), 6)  # in no balance: without weight
    assert (len(aside), aside.rigid) == (0, count)


@pytest.fixture(scope="module")
def blade():
    """Makes scenes of a blade of 0.5 m along x."""
    domain = rf.box((0, 0, 0), (0.5, 0.02, 0.01), (20, 1, 1))
    domain = domain.with_cells("tip", lambda x: x[0] > 0.4 - 1e-9)
    steel = rf.StVenantKirchhoff(E=2.1e11, nu=0.0, rho=7850.0)
    return lambda *effects, **how: rf.Scene(domain, steel, effects, order=2, **how)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_spin_stiffens_and_softens(blade, mass):
    """Flap and lag of a beam: μ = 6.4495 at η = Ω √(ρAL⁴/EI) = 5, and lag √(μ² - η²).

    A. D. Wright et al., J. Appl. Mech. 49 (1982) 197, table 1. A rigid tip hardly changes them.
    """
    bent = np.sqrt(2.1e11 * 0.01**2 / 12 / 7850.0) / 0.5**2  # √(EI/ρAL⁴)
    for lag, spin in ((True, (0, 5 * bent, 0)), (False, (0, 0, 5 * bent))):
        turns = rf.PrescribedRotation(
            "x0", axis=spin, through=(0, 0.01, 0.005), angle=lambda t: 5 * bent * t
        )
        turning = blade(turns, rf.Preload(spin=spin), mass=mass)
        report = next(iter(rf.simulate(turning, 1e-5, 1e-4)))
        exact = bent * np.sqrt(6.44954**2 - (25.0 if lag else 0.0)) / (2 * np.pi)
        for scene in (turning, blade(turns, rf.Rigid("tip"), mass=mass)):
            first = rf.modes(scene, 1, about=report).frequencies[0]
            np.testing.assert_allclose(first, exact, rtol=4e-3)


def test_coriolis_forces_are_not_passed_over(blade):
    """A free blade that turns has no modes without them; two parts that turn differently warn."""
    free = blade(rf.InitialVelocity(angular=(0, 300.0, 0)))
    report = next(iter(rf.simulate(free, 1e-5, 1e-4)))
    with pytest.raises(rf.SceneError, match=r"turns with 300 rad/s.*Coriolis"):
        rf.modes(free, 2, about=report)
    slow = blade(rf.InitialVelocity(angular=(0, 1.0, 0)))
    report = next(iter(rf.simulate(slow, 1e-5, 1e-4)))
    np.testing.assert_allclose(
        rf.modes(slow, 2, about=report).squares, rf.modes(slow, 2).squares, rtol=1e-6
    )
    parts = boxes(((0, 0, 0), (1, 1, 1), (1, 1, 1)), ((2, 0, 0), (3, 1, 1), (1, 1, 1)))
    parts = parts.with_cells("right", lambda x: x[0] > 1.5)
    soft = rf.StVenantKirchhoff(E=1e6, nu=0.0, rho=1000.0)
    one = rf.Scene(parts, soft, [rf.InitialVelocity(angular=(0, 0, 30.0), where="right")])
    report = next(iter(rf.simulate(one, 1e-5, 1e-4)))
    with pytest.warns(UserWarning, match="angular velocities that differ by 30 rad/s"):
        rf.modes(one, 2, about=report)


def test_a_free_state_that_turns_is_begun_from_once(blade, monkeypatch):
    """Modes are looked for with its spin and without, and what is told of a start is told once."""
    slow = blade(rf.InitialVelocity(angular=(0, 1.0, 0)))
    report = next(iter(rf.simulate(slow, 1e-5, 1e-4)))
    kind, begun = type(report), []
    begin = kind.to_start_from
    monkeypatch.setattr(kind, "to_start_from", lambda of: begun.append(of) or begin(of))
    rf.modes(slow, 2, about=report)
    assert len(begun) == 1


def test_rayleigh_damping_has_both_ratios():
    drag, viscous = rf.rayleigh(2.0, 30.0, 0.02, 0.05)
    for f, ratio in ((2.0, 0.02), (30.0, 0.05)):
        w = 2 * np.pi * f
        assert abs(drag.alpha / (2 * w) + viscous.beta * w / 2 - ratio) < 1e-15
    with pytest.raises(rf.SceneError, match="first must be below second"):
        rf.rayleigh(3.0, 2.0, 0.1)
    with pytest.raises(rf.SceneError, match="the second must lie between"):
        rf.rayleigh(1.0, 2.0, 0.1, 0.3)


def test_shapes_are_written_and_drawn(tmp_path):
    found = rf.modes(beam(rf.Fixed("x0")), 3)
    series = found.write(tmp_path / "out").read_text()
    assert [f'timestep="{f!r}"' in series for f in map(float, found.frequencies)] == [True] * 3
    found.draw(tmp_path / "modes.png")
    assert (tmp_path / "modes.png").stat().st_size > 10_000


def test_description_has_them_where_they_are_cheap(monkeypatch, capsys):
    scene = beam(rf.Fixed("x0"), order=2)
    first, *_ = rf.periods(scene)
    line = f"without loads: {first:.4g}, "
    assert line in scene.describe(dt=1e-3)
    assert f"the first is {first / 1e-3:.3g} steps of Δt = 0.001 s" in scene.describe(1e-3, 1)
    assert "Periods" not in scene.describe(periods=0)
    monkeypatch.setattr(module, "CHEAP", 100)
    assert "describe(periods=3) finds them" in scene.describe()
    assert line in scene.describe(periods=2)


@pytest.mark.parametrize(
    "load", [rf.Motor("pin", torque=1.0), rf.Gravity((0, 0, -9.81)), rf.Gravity((0, -9.81, 0))]
)
def test_a_motion_that_no_load_resists_is_no_mode(load):
    """A rigid block turns about its centre: a torque, and weights, leave rounding in ω²."""
    domain = rf.box((0, 0, 0), (0.1, 0.1, 0.1), (1, 1, 1)).with_cells("block", lambda x: x[0] > -1)
    pin = rf.Revolute("ground", "block", (0.05, 0.05, 0), (0, 0, 1), name="pin")
    assert rf.modes(rf.Scene(domain, STEEL, [rf.Rigid("block"), pin, load]), 3).squares.size == 0


def test_a_motor_of_given_angle_locks_modes():
    """As a tie at the same face."""
    face, at = rf.MeanFace("x0"), (0, WIDE / 2, HIGH / 2)
    hinge = rf.Revolute("ground", face, at, (0, 1, 0), name="pin")
    locked = rf.modes(beam(hinge, rf.Motor("pin", angle=0.0), n=(5, 1, 1)), 2)
    tied = rf.modes(beam(rf.Tied("ground", face, at), n=(5, 1, 1)), 2)
    assert locked.squares == pytest.approx(tied.squares, rel=1e-9)


if __name__ == "__main__":
    tell(on_ranks())

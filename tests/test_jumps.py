"""A warning of prescribed paths that jump, and none of those that only bend or hurry."""

import warnings
from contextlib import contextmanager

import numpy as np
import pytest

import rigidfx as rf

# Paths that begin at full speed or hurry, and obstacles that strike: their jumps are the subject.
OTHERS = (
    ".* acts with a jolt",
    "Contact .* closed at .* and opened again",
    ".* goes back and forth",
    ".* nothing acts",
    ".* velocity changes faster than",
    "Contact .* pressed until the run ended",
)
pytestmark = [pytest.mark.filterwarnings(f"ignore:{text}") for text in OTHERS]


@contextmanager
def no_word_of_jumps():
    """Takes warnings for errors, but for those of blows."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", rf.RigidfxWarning)
        for text in OTHERS:
            warnings.filterwarnings("ignore", text)
        yield


DT = 0.1


def moved(x, velocity=None, **window):
    """A bar of two cells whose end follows a path along x."""
    path = rf.PrescribedMotion(
        "x0",
        displacement=lambda t: (x(t), 0.0, 0.0),
        velocity=None if velocity is None else lambda t: (velocity(t), 0.0, 0.0),
        **window,
    )
    material = rf.NeoHooke(E=1e3, nu=0.0, rho=10.0)
    return rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), material, [path])


def run(scene, t_end=1.0):
    return list(rf.simulate(scene, DT, t_end))


def velocities(reports):
    """Of the nodes that are moved, along x, step by step [m/s]."""
    return [r.state.v.x.array.reshape(-1, 3)[r.state.X[:, 0] == 0, 0].copy() for r in reports]


JUMPS = {
    "once": (lambda t: 0.1 * (t >= 0.45), 0.45),
    "at the end of a step": (lambda t: 0.1 * (t >= 0.3), 0.3),
    "while it moves": (lambda t: 0.2 * t + 0.1 * (t > 0.72), 0.72),
    "back, as saws": (lambda t: 0.4 * (t % 0.55), 0.55),
    "often": (lambda t: 0.02 * np.floor(t / 0.07 + 1e-9), 0.07),
}


@pytest.mark.parametrize("name", JUMPS)
def test_a_jump_is_warned_of_once(name):
    path, t = JUMPS[name]
    with pytest.warns(rf.RigidfxWarning, match="its path jumps by") as shown:
        run(moved(path))
    (said,) = [str(w.message) for w in shown if "jumps" in str(w.message)]
    assert float(said.split("at t = ")[1].split(" s")[0]) == pytest.approx(t, abs=1e-6)


PLACES = {
    "a rotation": lambda f: rf.PrescribedRotation("x0", axis=(0, 0, 1), angle=f),
    "a path of place": lambda f: rf.PrescribedMotion(
        "x0", displacement=lambda x, t: np.stack([0 * x[0], f(t) * x[2], 0 * x[0]])
    ),
}


def placed(name, f):
    material = rf.NeoHooke(E=1e3, nu=0.0, rho=10.0)
    return rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), material, [PLACES[name](f)])


@pytest.mark.parametrize(("name", "size"), [("a rotation", 0.0998), ("a path of place", 0.1)])
def test_a_jump_of_what_moves_each_node_in_its_own_way_is_warned_of(name, size):
    """Only paths that move all nodes alike were looked at."""
    scene = placed(name, lambda t: 0.1 * (t >= 0.45))
    with pytest.warns(rf.RigidfxWarning, match=f"jumps by {size} m at t = 0.45 s") as shown:
        run(scene)
    assert sum("jumps" in str(w.message) for w in shown) == 1


def test_what_turns_or_moves_by_place_and_does_not_jump_passes():
    """An angle that is counted anew after each turn moves nothing by that."""
    turn = 2 * np.pi
    with no_word_of_jumps():
        run(placed("a rotation", lambda t: (turn - 0.02 + 0.1 * t) % turn), t_end=0.5)
        run(placed("a path of place", lambda t: 0.05 * np.sin(3 * t)), t_end=0.5)


def test_what_the_warning_says_of_the_nodes():
    """Twice the jump over Δt, with alternating sign, and half of Δt doubles it."""
    for dt in (DT, DT / 2):
        with pytest.warns(rf.RigidfxWarning, match=f"a velocity of {0.02 / dt:.3g} m/s"):
            found = velocities(rf.simulate(moved(lambda t: 0.01 * (t > 0.42)), dt, 0.8))
        late = np.array(found)[-4:]
        signs = np.array([1, -1, 1, -1])[:, None] * np.sign(late[0])
        np.testing.assert_allclose(late, signs * 0.02 / dt, rtol=1e-9)


def ramp(begin, length):
    """From 0 to 0.1 m within so long a time."""
    return lambda t: 0.1 * min(max((t - begin) / length, 0.0), 1.0)


SOUND = {
    "sine, ten steps a period": lambda t: 0.05 * np.sin(2 * np.pi * t),
    "sine, 2.3 steps a period": lambda t: 0.01 * np.sin(2 * np.pi * t / 0.23),
    "cosine from its top": lambda t: 0.05 * np.cos(2 * np.pi * t),
    "sudden ramp": ramp(0.3, 0.5),
    "sudden ramp within a step": ramp(0.3999, 0.5),
    "ramp that begins at a rounded time": ramp(0.1 + 0.2, 0.5),
    "ramp that begins at the end of a step": lambda t: 10 * max(t - 0.5 + 1.2e-7, 0.0),
    "ramp of a thousandth of a step": ramp(0.42, 1e-4),
    "smooth step": lambda t: 0.05 * np.tanh((t - 0.5) / 0.02),
    "root": lambda t: 0.05 * np.sqrt(max(t - 0.31, 0.0)),
    "far away": lambda t: 1e6 + 0.05 * np.sin(2 * np.pi * t),
    "held far away": lambda t: 1e6 * (1 + 1e-16 * np.sin(1e3 * t)),
    "table": rf.Table((0.0, 0.31, 0.62, 1.0), (0.0, 0.1, -0.1, 0.0)),
    "begins elsewhere": lambda t: 0.1 + 0.05 * t,
}


@pytest.mark.parametrize("name", SOUND)
def test_other_paths_pass(name):
    with no_word_of_jumps():
        run(moved(SOUND[name]), 0.6 if "at the end" in name else 1.0)


def test_only_increments_of_a_path_count():
    """One that begins elsewhere moves its nodes as one that begins at zero."""

    def ends(offset):
        return run(moved(lambda t: offset + 0.05 * t))[-1].state.u.x.array.copy()

    np.testing.assert_allclose(ends(0.7), ends(0.0), atol=1e-12)


def test_components_that_are_not_held_may_jump():
    scene = moved(lambda t: 0.1 * (t >= 0.45), components="yz")
    with no_word_of_jumps():
        run(scene)


# Obstacles -------------------------------------------------------------------------------------


def met(path, gap=1e-3, **options):
    """A block at rest over a plane that follows a path upwards."""
    plane = rf.Plane((0, 0, -gap), (0, 0, 1), path=lambda t: (0.0, 0.0, path(t)))
    block = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    contact = rf.Contact("z0", against=plane, **options)
    return rf.Scene(block, rf.NeoHooke(E=1e3, nu=0.0, rho=10.0), [contact])


@pytest.mark.parametrize("at", [0.45, 0.5])
def test_an_obstacle_that_jumps_into_a_body_is_told(at):
    """It gives energy in one step, which was booked as work of supports without a word."""
    with pytest.warns(rf.RigidfxWarning, match="path of the Plane jumps") as shown:
        reports = run(met(lambda t: 0.02 * (t >= at)), t_end=0.7)
    (said,) = [m for m in (str(w.message) for w in shown) if "jumps" in m]
    work = max(report.work_of_supports for report in reports)
    assert work > 0.1
    assert f"jumps by 0.02 m at t = {at} s, where nodes touch it" in said
    assert f"gives the structure {work:.3g} J" in said
    energies = [report.energy for report in reports]
    gained = sum(report.work_of_supports for report in reports)
    assert energies[-1] == pytest.approx(energies[0] + gained, rel=1e-9)


CLEAR = {
    "jump away from it": (lambda t: -0.02 * (t >= 0.45), 1e-3),
    "jump below it": (lambda t: 0.02 * (t >= 0.45), 0.5),
    "sudden ramp": (ramp(0.3, 0.5), 0.05),
    "sine": (lambda t: 0.05 * np.sin(2 * np.pi * t), 1e-3),
}


@pytest.mark.parametrize("name", CLEAR)
def test_an_obstacle_that_does_no_harm_passes(name):
    path, gap = CLEAR[name]
    with no_word_of_jumps():
        run(met(path, gap), t_end=0.7)


def test_an_obstacle_is_not_asked_for_where_it_is_while_its_contact_does_not_act():
    """Its path may be known for the window only."""
    asked = []

    def path(t):
        asked.append(t)
        return 0.0

    run(met(path, since=0.25, until=0.5), t_end=0.8)
    assert 0.2 < min(asked) <= max(asked) < 0.6

"""A given velocity that is not the derivative of its path is refused, and no other is."""

from __future__ import annotations

import numpy as np
import pytest

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

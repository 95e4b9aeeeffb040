"""Where steps end."""

from itertools import pairwise

import numpy as np
import pytest

from rigidfx.base.instants import at_latest, longer, reached, resolution
from rigidfx.scene.timeline import Timeline


def ends(timeline):
    """The ends of all steps."""
    t, out = 0.0, []
    while not timeline.over(t):
        t = timeline.next(t)
        out.append(t)
    return out


def test_the_step_changes_at_its_times():
    timeline = Timeline({0.0: 0.2, 0.5: 0.05, 0.6: 0.3}, 1.0)
    assert ends(timeline) == pytest.approx([0.2, 0.4, 0.5, 0.55, 0.6, 0.9, 1.0], abs=1e-15)


def test_a_long_grid_does_not_drift():
    found = ends(Timeline(0.1, 1000.0))
    assert len(found) == 10_000
    assert max(abs(t - 0.1 * (k + 1)) for k, t in enumerate(found)) <= 1e-12


def test_small_steps_late_in_a_run_go_on():
    """There numbers are 1.5e-11 s apart, more than a billionth of a step."""
    found = ends(Timeline({0.0: 100.0, 86400.0: 1e-6}, 86400.0 + 1e-5))
    assert len(found) == 864 + 10
    steps = [b - a for a, b in pairwise(found[863:])]
    assert steps == pytest.approx([1e-6] * 10, abs=3e-11)


def test_steps_after_the_end_are_not_asked_for():
    assert ends(Timeline({0.0: 0.5, 2.0: 1e-30}, 1.0)) == [0.5, 1.0]


def test_rounding_of_sums_is_the_same_instant():
    t = 1 - 0.9
    assert t < 0.1
    assert reached(t, 0.1, 0.1)
    assert not longer(0.1, t)


@pytest.mark.parametrize("t", [0.0, 3.0, 86400.0])
def test_a_step_earlier_is_another_instant(t):
    """Late in a run of small steps too: 1e-9 of the time itself were 86 of these steps."""
    dt = 1e-6
    assert not reached(t, t + dt, dt)
    assert not reached(t, t + dt / 256, dt / 256)
    assert reached(t + dt, t + dt, dt)
    assert resolution(t, dt) < dt / 256


def test_a_cut_step_ends_where_the_whole_one_would():
    """Instants are known to 1e-9 of the whole step, which was 256 times as long."""
    dt = 0.01
    assert reached(1.0 - 1e-9 * dt, 1.0, dt / 256)


def test_arrays_go_through():
    t = np.array([0.1, 0.2, 0.3])
    np.testing.assert_array_equal(reached(t, 0.2, 0.1), [False, True, True])
    assert at_latest(t, 0.1).shape == (3,)

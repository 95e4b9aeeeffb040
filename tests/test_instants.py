"""When two times are the same instant."""

from __future__ import annotations

import numpy as np
import pytest

from rigidfx.base.instants import at_latest, longer, reached, resolution


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

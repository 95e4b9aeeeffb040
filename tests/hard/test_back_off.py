"""Cells that were released too soon, again and again, wait longer and longer: a pure rule."""

import numpy as np
import pytest

from rigidfx.decide.memory import BackOff

WINDOW = 1.0  # s
YES, NO = np.array([True]), np.array([False])


def waited(rule, able, length):
    """Cells that have waited long enough at the end of a window, which the rule takes note of."""
    lasting = rule.lasting(able)
    rule.window_ended(able, length)
    return lasting


def freezes(growth, windows, life):
    """Times of freezes of a cell that always qualifies and is released after so long."""
    rule, t, begin, times, until = BackOff(1, growth), 0.0, 0.0, [], np.inf
    rigid = NO
    while t < windows * WINDOW:
        t += 0.25
        if t >= until:
            rigid, until, begin = NO, np.inf, t
            rule.switched(rigid, t, counts=True)
            rule.restart()
        elif t >= begin + WINDOW and not rigid[0]:
            lasting = waited(rule, YES, t - begin)
            begin = t
            if lasting[0]:
                rigid, until = YES, t + life
                rule.switched(rigid, t, counts=True)
                times.append(t)
    return times


def test_alternating_switches_become_rare():
    assert len(freezes(1.0, 1000, 0.25)) == 800
    times = freezes(2.0, 1000, 0.25)
    assert len(times) <= np.log2(1000) + 2
    gaps = np.diff(times)
    assert gaps[0] == WINDOW + 0.25  # the first hasty release is forgiven
    assert gaps[1:] == pytest.approx(WINDOW * 2.0 ** np.arange(1, len(gaps)) + 0.25)


def test_cell_that_stays_rigid_for_long_never_waits():
    times = freezes(2.0, 100, 1.5)
    assert np.diff(times) == pytest.approx(2.5)


def test_long_life_is_rewarded():
    rule = BackOff(1, 3.0)
    for t in (1.0, 2.0, 3.0):
        waited(rule, YES, WINDOW)
        rule.switched(YES, t, counts=True)
        rule.switched(NO, t + 0.1, counts=True)
    assert rule.needed() == [9.0]
    for _ in range(9):
        able = waited(rule, YES, WINDOW)
    assert able[0]
    rule.switched(YES, 20.0, counts=True)
    rule.switched(NO, 40.0, counts=True)
    assert rule.needed() == [1.0]


def test_planned_releases_do_not_count():
    rule = BackOff(1, 2.0)
    for t in range(5):
        waited(rule, YES, WINDOW)
        rule.switched(YES, t, counts=True)
        assert not rule.switched(NO, t + 0.1, counts=False)
    assert rule.needed() == [1.0]


def test_window_that_fails_begins_the_count_anew():
    rule = BackOff(1, 2.0)
    rule.hasty[:] = 3  # four windows
    answers = [waited(rule, able, WINDOW)[0] for able in [YES, YES, NO, YES, YES, YES, YES]]
    assert answers == [False] * 6 + [True]

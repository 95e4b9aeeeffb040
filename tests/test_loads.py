"""Loads: how much arrives, where and when."""

from __future__ import annotations

import numpy as np
import pytest
from histories import EPS, NEWTON
from hypothesis import given
from hypothesis import strategies as st

import rigidfx as rf

MATERIAL = rf.StVenantKirchhoff(rho=2.0, E=50.0, nu=0.3)
STIFF = rf.StVenantKirchhoff(rho=2.0, E=5e3, nu=0.3)  # bears a force on one vertex


def _domain(cell="hexahedron"):
    return (
        rf.box((0, 0, 0), (4, 2, 1), (4, 2, 1), cell)
        .with_vertices("corner", lambda x: np.isclose(x.sum(axis=0), 7.0))
        .with_cells("left", lambda x: x[0] < 1 + 1e-9)
    )


def _impulse(load, dt=0.125, t_end=1.0, material=MATERIAL, **options):
    """Momentum of a free body at the end, which is the impulse of its loads."""
    *_, last = rf.simulate(rf.Scene(_domain(), material, [load], **options), dt, t_end)
    return last.linear_momentum


Q = np.array([1.0, -2.0, 0.5])


@pytest.mark.parametrize(
    ("load", "total"),
    [
        (rf.NodalForce("x1", tuple(Q)), 1.0),  # facets
        (rf.NodalForce("corner", tuple(Q)), 1.0),  # a vertex
        (rf.NodalForce("left", tuple(Q)), 1.0),  # cells
        (rf.Traction("x1", tuple(Q)), 2.0),  # area 2 × 1
        (rf.Traction("z0", tuple(Q)), 8.0),
        (rf.BodyForce(tuple(Q)), 8.0),
        (rf.BodyForce(tuple(Q), where="left"), 2.0),
        (rf.Gravity(tuple(Q)), 16.0),
        (rf.Gravity(tuple(Q), where="left"), 4.0),
    ],
)
@pytest.mark.parametrize("order", [1, 2])
def test_total_force(load, total, order):
    """What arrives is what was asked: a total, a traction × area, a density × volume."""
    impulse = _impulse(load, material=STIFF, order=order)
    assert np.abs(impulse - total * Q).max() <= 100 * NEWTON * total


def test_nodal_force_is_shared_equally():
    """Each node of the set gets the same part, corners too."""
    scene = rf.Scene(_domain(), MATERIAL, [rf.NodalForce("x1", tuple(Q))])
    *_, last = rf.simulate(scene, 1e-6, 1e-6)
    # In so short a step only inertia answers: m v = q Δt / n.
    p = scene.nodal_mass[:, None] * last.state.v.x.array.reshape(-1, 3)
    nodes = scene.nodes("x1", "test")
    assert nodes.size == 6
    assert np.abs(p[nodes] - Q * 1e-6 / 6).max() <= 1e-10 * 1e-6


@pytest.mark.parametrize(
    "make",
    [
        lambda **w: rf.NodalForce("x1", tuple(Q), **w),
        lambda **w: rf.Traction("x1", tuple(Q / 2), **w),
        lambda **w: rf.BodyForce(tuple(Q / 8), **w),
        lambda **w: rf.Gravity(tuple(Q / 16), **w),
    ],
)
def test_window(make):
    """A load acts from since to until, wherever these lie on the grid of steps."""
    assert np.abs(_impulse(make(since=0.2, until=0.77)) - 0.57 * Q).max() <= 100 * NEWTON
    assert np.abs(_impulse(make(since=0.9)) - 0.1 * Q).max() <= 100 * NEWTON
    assert np.abs(_impulse(make(until=0.4)) - 0.4 * Q).max() <= 100 * NEWTON
    for window in ({"since": 2.0}, {"since": -3.0, "until": -1.0}):
        with pytest.warns(rf.RigidfxWarning, match="does nothing from 0 to 1 s"):
            assert np.abs(_impulse(make(**window))).max() == 0.0


@given(
    times=st.lists(st.integers(0, 40), min_size=1, max_size=5, unique=True).map(sorted),
    data=st.data(),
)
def test_table_is_piecewise_linear(times, data):
    """Values at its times, straight in between, constant outside; kinks are breakpoints."""
    times = [t / 20 for t in times]
    values = data.draw(st.lists(st.floats(-10, 10), min_size=len(times), max_size=len(times)))
    table = rf.Table(times, values)
    assert [table(t) for t in times] == pytest.approx(values, abs=20 * EPS)
    assert table(times[0] - 1) == pytest.approx(values[0], abs=20 * EPS)
    assert table(times[-1] + 1) == pytest.approx(values[-1], abs=20 * EPS)
    for a, b, p, q in zip(times, times[1:], values, values[1:], strict=False):
        assert table((3 * a + b) / 4) == pytest.approx((3 * p + q) / 4, abs=100 * EPS)
    assert list(table.breakpoints) == times


def test_impulse_of_a_table_is_exact():
    """Steps end at the kinks, so that midpoint values integrate the table exactly."""
    table = rf.Table((0.1, 0.33, 0.8), (0.0, 3.0, 1.0))
    area = 0.23 * 1.5 + 0.47 * 2 + 0.2 * 1.0
    load = rf.NodalForce("x1", tuple(Q), time=table)
    assert np.abs(_impulse(load) - area * Q).max() <= 100 * NEWTON


def test_value_as_a_function_of_time():
    """The value may itself turn in time; it is taken at midpoints."""

    def value(t):
        return (np.cos(t), np.sin(t), 0.0)

    middles = (np.arange(8) + 0.5) * 0.125
    expected = 0.125 * np.array([value(t) for t in middles]).sum(axis=0)
    assert np.abs(_impulse(rf.NodalForce("x1", value)) - expected).max() <= 100 * NEWTON
    both = rf.NodalForce("x1", value, time=lambda t: 2.0)
    assert np.abs(_impulse(both) - 2 * expected).max() <= 100 * NEWTON

"""A recorded ground acceleration, as a load and as the motion of a support."""

from __future__ import annotations

import numpy as np
import pytest
from known.motions import DEFORMATION, INCH, RATIO, by_gravity, by_support, el_centro, storey
from scipy.interpolate import make_interp_spline
from scipy.signal import lsim

import rigidfx as rf


def oscillator(T, t, a, finer=8):
    """The largest displacement of the exact oscillator, a being linear between its instants."""
    omega = 2 * np.pi / T
    fine = np.linspace(t[0], t[-1], (t.size - 1) * finer + 1)
    system = [-1.0], [1.0, 2 * RATIO * omega, omega**2]
    return np.abs(lsim(system, np.interp(fine, t, a), fine)[1]).max()


@pytest.mark.parametrize("way", [by_gravity, by_support])
@pytest.mark.parametrize(
    ("T", "dt", "until"), [(0.5, 0.01, 3), (1.0, 0.01, 5.2), (2.0, 0.02, 11.6)]
)
def test_el_centro(T, dt, until, way):
    """The reference within 1 %, the exact oscillator of this record within what Δt errs by."""
    t, a = el_centro()
    scene = storey(T, way(t, a))
    path = make_interp_spline(t, a, k=1).antiderivative(2)
    most = 0.0
    for report in rf.simulate(scene, dt, until, progress=False):
        ground = float(path(report.t)) if way is by_support else 0.0
        most = max(most, abs(report.probes["roof"][0] - ground))
    assert most / INCH == pytest.approx(DEFORMATION[T], rel=0.01)
    assert most == pytest.approx(oscillator(T, t, a), rel=3e-3)

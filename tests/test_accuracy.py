"""Tolerances that follow from the run."""

import numpy as np

import rigidfx as rf

SOFT = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)


def swinging():
    """A clamped bar that is pushed for a second, and swings about ever after."""
    box = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
    push = rf.Traction("x1", (0, 0, 200.0), until=1.0)
    return rf.Scene(box, SOFT, [rf.Fixed("x0"), push, rf.MassDamping(1.0)])


def run(rule, scene=None, t_end=4.0):
    scene = swinging() if scene is None else scene
    out = []
    for report in rf.simulate(scene, 0.05, t_end, rigidify=rule, progress=False):
        rates = np.array(report.strain_rate)
        out.append((report.t, report.unknowns, report.energy, float(rates.max(initial=0.0))))
    return np.array(out)


def test_a_relative_tolerance_is_a_part_of_the_largest_rate():
    """Of a largest rate that is over when the first window ends: as its number is, to rounding."""
    found = run(rf.StrainRate(0.0, 1e9))
    k = int(np.argmax(found[:, 3]))
    part, first = 0.5, max(float(found[k, 0]), 1.0) + 0.5
    both = part * found[k, 3], rf.Relative(part)
    number, relative = (run(rf.StrainRate(tol, first)) for tol in both)
    assert np.allclose(relative, number, rtol=0, atol=1e-10 * np.abs(number).max(axis=0))
    assert number[:, 1].min() < number[0, 1]


def test_noise_of_a_body_at_rest_is_no_rate():
    """Nothing is decided by it, of which a run would warn."""
    box = rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
    scene = rf.Scene(box, SOFT, [rf.Fixed("x0"), rf.Traction("x1", (0, 0, 200.0), since=1.0)])
    found = run(rf.StrainRate(rf.Relative(0.1), 0.3), scene, 1.5)
    assert found[found[:, 0] > 1.01][0, 1] == found[0, 1]

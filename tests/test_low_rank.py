"""A kept tangent follows contacts: the correction against a dense solve, and what it saves."""

import numpy as np

import rigidfx as rf
from rigidfx.step.newton.low_rank import LowRank


def test_a_corner_that_comes_and_goes_takes_few_tangents(monkeypatch):
    """Two thirds of those without the correction, or less, and the same motion."""

    def struck():
        plastic = rf.StVenantKirchhoff(E=2.4e9, nu=0.35, rho=1200.0)
        bar = rf.box((0, 0, 1e-4), (0.2, 0.1, 0.1001), (8, 4, 4))
        scene = rf.Scene(
            bar.with_facets("skin", lambda x: np.isclose(x[2], 1e-4)),
            plastic,
            [
                rf.Contact("skin", against=rf.Sphere((0.05, 0.05, -0.3), 0.3)),
                rf.InitialVelocity(linear=(0.5, 0, -2.0), angular=(3.0, 20.0, 5.0)),
            ],
        )
        *_, last = reports = list(rf.simulate(scene, 4e-5, 1.6e-3, progress=False))
        return sum(r.tangents for r in reports if r.step), last.angular_momentum

    tangents, momentum = struck()
    monkeypatch.setattr(LowRank, "follow", lambda *given: False)
    without, same = struck()
    assert 3 * tangents <= 2 * without
    assert np.allclose(momentum, same, rtol=1e-9)

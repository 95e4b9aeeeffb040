"""Second-order tetrahedra with consistent mass: row sums are negative at their vertices."""

from __future__ import annotations

import numpy as np
import pytest
from hardcases.cad_parts import lug_scene

import rigidfx as rf
from rigidfx.decide import paying


@pytest.fixture(scope="module")
def scene():
    return lug_scene(1.0, 2, "consistent")


def test_averaging_mass_is_positive(scene):
    """Nodal masses are not, though they add up to the mass; point masses count in both."""
    assert scene.nodal_mass.min() < 0 < scene.averaging_mass.min()
    n = scene.owned_nodes
    assert scene.sum(scene.nodal_mass[:n].sum()) == pytest.approx(1000.0 * (8 + 18), rel=1e-12)


@pytest.mark.slow
def test_an_estimate_that_fails_costs_a_freeze(monkeypatch):
    """A run warns and goes on to its end, all flexible."""

    def fails(*args):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(paying.Paying, "bodies", fails)
    bar = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)),
        rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=1000.0),
        [rf.InitialVelocity(angular=(0.0, 0.0, 0.1))],
    )
    with pytest.warns(rf.RigidfxWarning, match="an estimate at the end of a window failed"):
        reports = list(rf.simulate(bar, 0.1, 2.0, rigidify=rf.StrainRate(1e9, 0.5)))
    assert reports[-1].t == pytest.approx(2.0)
    assert not reports[-1].bodies

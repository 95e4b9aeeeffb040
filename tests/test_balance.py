"""A run that loses its balance of energy says so, once, and no other does."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rigidfx as rf


def spinning(scheme=None):
    return rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)),
        rf.StVenantKirchhoff(E=1e3, nu=0.3, rho=1.0),
        [
            rf.InitialVelocity(angular=(0.3, 0.5, 2.0)),
            rf.Traction("x1", (1.0, 5.0, 0.0), until=1.0),
            rf.MassDamping(0.1),
        ],
        scheme=scheme,
    )


def test_a_loose_newton_is_found_out(petsc_options):
    petsc_options["snes_rtol"] = 0.5
    with pytest.warns(rf.RigidfxWarning, match="balance of energy is off by") as shown:
        reports = list(rf.simulate(spinning(), 0.2, 6.0))
    assert len(shown) == 1
    expected = reports[0].energy + sum(
        r.work_of_loads + r.work_of_supports - sum(r.dissipated.values()) for r in reports
    )
    assert abs(reports[-1].energy / expected - 1) > 1e-4


@pytest.mark.parametrize("material", [rf.StVenantKirchhoff, rf.NeoHooke])
@pytest.mark.parametrize("load", [1.0, 1e4])
def test_rounding_at_small_strains_is_no_loss(material, load):
    """A beam of steel, from rest, with parts that freeze before anything happens."""
    scene = rf.Scene(
        rf.box((0, 0, 0), (1, 0.1, 0.1), (10, 1, 1)),
        material(E=2.1e11, nu=0.3, rho=7850.0),
        [rf.Fixed("x0"), rf.NodalForce("x1", (0.0, 0.0, load), since=0.05)],
    )
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")  # another one says that the window is short
        reports = list(rf.simulate(scene, 0.01, 0.2, rigidify=rf.StrainRate(1e-3, 0.02)))
    assert [e.kind for r in reports for e in r.events][:2] == ["freeze", "release"]
    assert not [w for w in shown if "balance" in str(w.message)]


@pytest.mark.parametrize("scheme", [None, rf.Midpoint()])
def test_sound_runs_and_schemes_that_promise_nothing_are_silent(scheme):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reports = list(rf.simulate(spinning(scheme), 0.2, 3.0))
    assert np.isfinite(reports[-1].energy)

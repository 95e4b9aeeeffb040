"""A run that loses its balance of energy says so, once, and no other does."""

import warnings
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from histories import heard

import rigidfx as rf
from rigidfx.report.energy_balance import EnergyBalance


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
    expected = reports[0].energy + sum(r.supplied for r in reports)
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
    with heard() as found:  # another one says that the window is short
        reports = list(
            rf.simulate(scene, 0.01, 0.2, rigidify=rf.StrainRate(1e-3, 0.02, wake="all"))
        )
    assert [e.kind for r in reports for e in r.events][:2] == ["freeze", "release"]
    assert not [text for text in found if "balance of energy" in text]
    told = sum("The energies of this run are rounding to" in text for text in found)
    assert told == (material is rf.NeoHooke and load == 1.0)  # a fifth of 2e-7 J


@pytest.mark.parametrize("scheme", [None, rf.Midpoint()])
def test_sound_runs_and_schemes_that_promise_nothing_are_silent(scheme):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reports = list(rf.simulate(spinning(scheme), 0.2, 3.0))
    assert np.isfinite(reports[-1].energy)


@dataclass(frozen=True, kw_only=True)
class CalledQuadratic(rf.NeoHooke):
    """What a user may do: the averaged stress conserves the energy of quadratic W only."""

    quadratic: ClassVar[bool] = True


def test_a_balance_that_is_lost_is_named_while_it_happens():
    """20 times its energy comes from nowhere; what ends the run is not to blame on the material."""
    scene = rf.Scene(
        rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)),
        CalledQuadratic(E=1e3, nu=0.3, rho=1.0),
        [rf.InitialVelocity(angular=(1.8, 3.0, 12.0))],
    )
    reports = []
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", ".*rad per step")
        try:
            for report in rf.simulate(scene, 0.1, 30.0):
                reports.append((report.t, report.energy, len(shown)))
        except rf.InversionError as error:
            message = str(error)
    off, lost = (str(w.message) for w in shown)
    assert "the balance of energy is off by" in off
    assert "the balance of energy is lost" in lost
    assert "J are accounted for: look for the cause of that first." in message
    assert "NeoHooke" not in message
    t, energy, _ = next(row for row in reports if row[2] == 2)  # in the very step
    assert f"At t = {t:.6g} s the energy was {energy:.3g} J" in lost
    assert energy > 2 * reports[0][1]
    assert all(e <= 2 * reports[0][1] * (1 + 1e-9) for when, e, _ in reports if when < t)


def test_releases_that_gain_energy_are_named():
    """A tenth of the energy; of no event, rounding is named."""
    scene = spinning()
    first, second = list(rf.simulate(scene, 0.2, 0.2))
    gain = 0.1 * first.energy
    more = replace(second, energies=replace(second.energies, kinetic=second.kinetic + gain))
    for events, words in ((SimpleNamespace(energy_lost=-gain),), "were released"), ((), "Rounding"):
        balance = EnergyBalance(scene)
        balance.follow(first)
        with pytest.warns(rf.RigidfxWarning, match=words):
            balance.follow(replace(more, events=events))


def halves(material, ratio, effects=()):
    """A bar that spins, one half of it as soft as before and one stiffer."""
    bar = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    bar = bar.with_cells("left", lambda X: X[0] < 1.5).with_cells("right", lambda X: X[0] > 0.5)
    soft = rf.NeoHooke(E=1e4, nu=0.3, rho=100)
    stiff = material(E=1e4 * ratio, nu=0.3, rho=100)
    spin = rf.InitialVelocity(angular=(0.3, 0.5, 2.0))
    return rf.Scene(bar, {"left": soft, "right": stiff}, [spin, *effects])


def test_what_rounding_in_the_stiffest_material_takes_is_told():
    """Where nothing but a softer scene would help: some tenth of the energy, by rounding."""
    reports = []
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always")
        for report in rf.simulate(halves(rf.NeoHooke, 1e14), 0.05, 1.0):
            told = [str(w.message) for w in shown if "balance of energy" in str(w.message)]
            reports.append((abs(report.energy / 323.25 - 1), len(told)))
    (message,) = told
    assert "of the largest energy. The energy of NeoHooke" in message
    assert (
        "a ratio of stiffness of 1e+14 is too much for so little energy. Make that part" in message
    )
    assert max(off for off, _ in reports) > 0.04  # twice as much as without a word
    assert all(off < 0.02 for off, told in reports if not told)


@pytest.mark.parametrize(
    ("material", "ratio", "effects"),
    [
        (rf.NeoHooke, 1e10, []),
        (rf.StVenantKirchhoff, 1e12, []),
        (rf.NeoHooke, 1e14, [rf.Rigid("right")]),
    ],
)
def test_what_is_advised_helps(material, ratio, effects):
    with heard("balance of energy") as found:
        reports = list(rf.simulate(halves(material, ratio, effects), 0.05, 1.0))
    assert not found
    assert abs(reports[-1].energy / reports[0].energy - 1) < 1e-4

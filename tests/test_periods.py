"""Periods of small vibrations: beams with known ones, bodies on springs, several ranks."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from parallel import report as tell
from parallel import run as mpirun

import rigidfx as rf
from rigidfx.coupling import periods as module

STEEL = rf.StVenantKirchhoff(E=2e11, nu=0.0, rho=8000.0)
LONG, WIDE, HIGH = 1.0, 0.1, 0.05


def beam(*effects, n=(20, 2, 2), **how):
    domain = rf.box((0, 0, 0), (LONG, WIDE, HIGH), n)
    domain = domain.with_cells("end", lambda x: x[0] > 0.8 * LONG - 1e-9)
    return rf.Scene(domain, STEEL, effects, **how)


def bending(number, thickness, long=LONG):
    """T of Bernoulli's beam of rectangular section [s]."""
    omega = (number / long) ** 2 * thickness * np.sqrt(2e11 / 8000.0 / 12)
    return 2 * np.pi / omega


@pytest.mark.parametrize(
    "how",
    [
        {"order": 2},
        {"order": 2, "mass": "consistent"},
        {"element": "enhanced", "n": (20, 4, 2)},
    ],
)
def test_cantilever(how):
    """Shear makes it slower than Bernoulli's, by 0.2 to 0.8 %."""
    found = rf.periods(beam(rf.Fixed("x0"), **how), 2)
    exact = [bending(1.875104, HIGH), bending(1.875104, WIDE)]
    assert np.all(found > exact)
    np.testing.assert_allclose(found, exact, rtol=0.008)


def test_free_beam_has_no_period_of_rigid_motions():
    found = rf.periods(beam(order=2), 1)
    np.testing.assert_allclose(found, bending(4.730041, HIGH), rtol=0.01)


def block(*effects, E=1e6, n=2):
    return rf.Scene(
        rf.box((0, 0, 0), (1, 1, 1), (n,) * 3),
        rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0),
        effects,
    )


def test_rigid_block_on_springs():
    """Vertically √(m/k); nothing is left of a block without springs."""
    springs = rf.Spring("z0", (1e4, 2e4, 4e4))
    found = rf.periods(block(springs, rf.Rigid()), 9)
    assert found.size == 6
    assert np.abs(found - 2 * np.pi * np.sqrt(1000.0 / 4e4)).min() < 1e-7
    np.testing.assert_allclose(rf.periods(block(springs, E=1e12), 6), found, rtol=1e-6)
    assert rf.periods(block(rf.Rigid())).size == 0


def test_rigid_part_is_as_a_stiff_one():
    """At the end of a cantilever; clamped, it shortens it.

    What a stiff part still gives is inversely proportional to its stiffness, so two of them tell
    its limit; to come nearer by one takes a stiffness whose rounding is as large as what it gives.
    """
    rigid = rf.periods(beam(rf.Fixed("x0"), rf.Rigid("end"), order=2), 2)
    domain = beam().domain.with_cells("rest", lambda x: x[0] < 0.8 * LONG + 1e-9)

    def twin(E):
        stiff = {"end": rf.StVenantKirchhoff(E=E, nu=0.0, rho=8000.0), "rest": STEEL}
        return rf.periods(rf.Scene(domain, stiff, [rf.Fixed("x0")], order=2), 2)

    np.testing.assert_allclose(rigid, (10 * twin(2e13) - twin(2e12)) / 9, rtol=2e-7)
    short = rf.periods(beam(rf.Fixed("end"), rf.Rigid("end"), order=2), 1)
    np.testing.assert_allclose(short, bending(1.875104, HIGH, 0.8 * LONG), rtol=0.01)


def cube():
    """A free cube, all of whose first periods but one in five are as those of a twin mode."""
    return rf.periods(block(n=6), 10)


def test_equal_periods_come_as_often_as_they_are(monkeypatch):
    found = cube()
    monkeypatch.setattr(module, "DENSE", 10**6)
    np.testing.assert_allclose(found, cube(), rtol=1e-7)
    np.testing.assert_allclose(found[[0, 2, 3, 5, 6]], found[[1, 3, 4, 6, 7]], rtol=1e-7)


@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_find_the_same(ranks):
    np.testing.assert_allclose(mpirun(__file__, ranks, 300), on_ranks(), rtol=1e-7)


def on_ranks():
    cantilever = beam(rf.Fixed("x0"), rf.Rigid("end"), order=2)
    return [*cube(), *rf.periods(cantilever), *rf.periods(block(rf.Spring("z0", 1e4), rf.Rigid()))]


def test_description_has_them_where_they_are_cheap(monkeypatch, capsys):
    scene = beam(rf.Fixed("x0"), order=2)
    first, *_ = rf.periods(scene)
    line = f"without loads: {first:.4g}, "
    assert line in scene.describe(dt=1e-3)
    assert f"the first is {first / 1e-3:.3g} steps of Δt = 0.001 s" in scene.describe(1e-3, 1)
    assert "Periods" not in scene.describe(periods=0)
    monkeypatch.setattr(module, "CHEAP", 100)
    assert "describe(periods=3) finds them" in scene.describe()
    assert line in scene.describe(periods=2)
    given = block(rf.Rigid(mass=3.0))
    assert "Periods" not in given.describe()
    for count in (0, -1, 1.5, True, "3"):
        with pytest.raises(rf.SceneError, match="periods: count must be a whole number ≥ 1"):
            rf.periods(scene, count)
    with pytest.raises(rf.SceneError, match="periods: scene must be a Scene, got NoneType"):
        rf.periods(None)
    with pytest.raises(rf.SceneError, match="mass or inertia of a Rigid part is given"):
        rf.periods(given)
    with pytest.raises(rf.SceneError, match="describe: periods must be a whole number ≥ 0"):
        scene.describe(periods=-1)


if __name__ == "__main__":
    found = on_ranks()
    if MPI.COMM_WORLD.rank == 0:
        tell(found)

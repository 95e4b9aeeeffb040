"""Joints: energy, both momenta, constraints, a pendulum's period, ranks, switches, bad input.

Run as a script under mpirun, this file reports histories of two joined bars.
"""

from __future__ import annotations

import numpy as np
import parallel
import pytest
from joints import PIN, SOFT, bars, follow
from mpi4py import MPI
from runs import prepared
from scipy.special import ellipk

import rigidfx as rf
from rigidfx.step.equations.equations import Equilibrium

NO_WARNINGS = pytest.mark.filterwarnings("ignore:Body")  # of few cells, whose lumped mass shows
PARTS = {
    "flexible": ((), None),
    "one rigid": ((rf.Rigid("A"),), ("A", rf.MeanFace("b"))),
    "both rigid": ((rf.Rigid("A"), rf.Rigid("B")), ("A", "B")),
    "faces of rigid parts": ((rf.Rigid("A"), rf.Rigid("B")), None),
}


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
@pytest.mark.parametrize("parts", PARTS)
def test_a_hinge_keeps_energy_and_both_momenta(parts, mass):
    """Two bars that tumble, whatever is rigid; the joint holds to rounding."""
    effects, sides = PARTS[parts]
    reports, H, L, J, held = follow(bars(*effects, sides=sides, mass=mass), 0.01, 40)
    assert max(H, L, J) <= 1e-12
    assert held[0] <= 1e-13
    assert held[1] <= 5e-3  # the sides' velocities differ by what the time integration leaves
    assert np.mean([r.iterations for r in reports[1:]]) <= 8
    turned = reports[-1].state.positions(np.arange(len(reports[-1].state.X)))
    assert np.abs(turned - reports[-1].state.X).max() > 0.5


def test_a_ball_joint_keeps_energy_and_both_momenta():
    """All three rotations are free."""
    _, H, L, J, held = follow(bars(ball=True), 0.01, 40)
    assert max(H, L, J) <= 1e-12
    assert held[0] <= 1e-13


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_joined_parts_become_rigid_and_flexible_again(mass):
    """Faces of the joint are in bodies, then in none, then in bodies; all at given times."""
    release = rf.Release(at=(0.25,))
    criterion = rf.StrainRate(1e9, 0.1, patience=1, wake="none", release=release)
    reports, H, L, J, held = follow(bars(mass=mass), 0.01, 45, rigidify=criterion)
    kinds = [event.kind for report in reports for event in report.events]
    assert kinds == ["freeze", "release", "freeze"]
    assert reports[-1].unknowns == 12
    assert max(H, L, J) <= 1e-12
    assert held[0] <= 1e-13
    assert held[1] <= 5e-3  # no switch leaves the sides different velocities


@NO_WARNINGS
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_velocities_that_do_not_fit_a_joint_are_met_by_impulses(mass):
    """A bar is thrown, the other rests: momenta stay, and what energy is lost is told."""

    def thrown(x):
        return np.where(x[:1] > PIN[0], np.array([[0.0], [1.0], [0.5]]), 0.0)

    scene = bars(rf.Rigid("A"), sides=("A", rf.MeanFace("b")), thrown=thrown, mass=mass)
    with pytest.warns(rf.RigidfxWarning, match=r"velocities do not fit the joints \(Revolute"):
        reports, H, L, J, held = follow(scene, 0.01, 10)
    assert max(H, L, J) <= 1e-12
    assert held[1] <= 5e-3
    loose = bars(rf.Rigid("A"), thrown=thrown, mass=mass, joined=False)
    first, *_ = rf.simulate(loose, 0.01, 0.01)
    given, impact = first.energy, reports[0].impact
    assert reports[0].energy == pytest.approx(given + impact.energy, rel=1e-12)
    assert 0.02 < -impact.energy / given < 0.9
    assert np.abs(impact.impulse).max() <= 1e-12 * reports[0].momentum_scale


def pendulum(cells):
    """A bar of 1 m on a hinge at its end, let go from the horizontal."""
    domain = rf.box((0, 0, 0), (1, 0.1, 0.1), (cells, 1, 1)).with_cells("bar", lambda x: x[0] > -1)
    hinge = rf.Revolute("ground", "bar", (0, 0.05, 0.05), (0, 0, 1))
    effects = [hinge, rf.Gravity((0, -9.81, 0)), rf.Rigid("bar")]
    return rf.Scene(domain, SOFT, effects, probes={"tip": (1, 0.05, 0.05)})


@NO_WARNINGS
def test_the_period_of_a_pendulum_converges_with_second_order():
    """Of a uniform bar it is 1.93334 s; of this one by its own moment of inertia."""
    scene = pendulum(10)
    m, X = scene.nodal_mass, scene.space.tabulate_dof_coordinates() - np.array([0, 0.05, 0.05])
    inertia, static = m @ (X[:, 0] ** 2 + X[:, 1] ** 2), m @ X[:, 0]
    exact = 4 * ellipk(0.5) * np.sqrt(inertia / (9.81 * static))
    assert 4 * ellipk(0.5) * np.sqrt(2 / (3 * 9.81)) == pytest.approx(1.93334, abs=1e-5)
    off = []
    for dt in (0.02, 0.01):
        reports = list(rf.simulate(scene, dt, 2.1))
        t, y = (
            np.array(a) for a in zip(*((r.t, r.probes["tip"][1]) for r in reports), strict=True)
        )
        k = int(np.argmax(np.where(t > 1.5, y, -1.0)))
        curve = np.polyfit(t[k - 3 : k + 4] - t[k], y[k - 3 : k + 4], 4)
        roots = np.roots(np.polyder(curve))
        off.append(t[k] + min(roots[np.isreal(roots)].real, key=abs) - exact)
        work = np.cumsum([r.work_of_loads for r in reports])
        assert np.abs([r.energy for r in reports] - work).max() <= 1e-12 * np.abs(work).max()
    assert abs(off[1]) <= 2.5e-4 * exact
    assert off[0] / off[1] == pytest.approx(4, rel=0.15)


def test_a_scene_without_joints_has_the_equations_that_it_had():
    """No row more, and not even another class."""
    with prepared(rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (2, 2, 2)), SOFT), 0.1) as run:
        system = run.stepper.system
        assert type(system.equilibrium) is Equilibrium
        assert system.linkage is None
        y = system.equilibrium.unknowns()
        assert y.size == system.equilibrium.prolongation.size == 81
        y.destroy()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rf.Revolute("a", "a", PIN, (0, 0, 1)), "both sides are the same"),
        (lambda: rf.Revolute("a", "ground", PIN, (0, 0, 0)), "its axis has no length"),
        (lambda: rf.Spherical(1.0, "ground", PIN), "a must be 'ground', the name of a Rigid part"),
        (lambda: rf.Spherical("a", "ground", (0, 0)), "at must be three finite numbers"),
        (lambda: rf.MeanFace(""), "where must be the name of a set of facets"),
    ],
)
def test_a_joint_that_cannot_be_is_refused(make, message):
    with pytest.raises(rf.SceneError, match=message):
        make()


@pytest.mark.parametrize(
    ("sides", "message"),
    [
        (("A", rf.MeanFace("b")), r"'A' is no Rigid part; there are none\..*MeanFace\('A'\)"),
        ((rf.MeanFace("ende"), rf.MeanFace("b")), "'ende'"),
        ((rf.MeanFace("cap"), rf.MeanFace("b")), "its nodes lie in a plane.*beside it, 0.01 m"),
    ],
)
def test_a_joint_that_does_not_fit_the_mesh_is_refused(sides, message):
    """By the joint's name and the side's, before anything runs."""
    domain = bars().domain.with_facets("cap", lambda x: np.isclose(x[0], 1.0))
    joint = rf.Revolute(*sides, PIN, (0, 0, 1), name="pin")
    with pytest.raises(rf.SceneError, match=message) as error:
        rf.Scene(domain, SOFT, [joint])
    assert "pin" in str(error.value)


def test_statics_and_modes_say_that_they_know_no_joints():
    scene = bars()
    for ask in (lambda: list(rf.static(bars())), lambda: rf.modes(scene)):
        with pytest.raises(rf.SceneError, match=r"joints are not followed|InitialVelocity"):
            ask()


def history(mass):
    """Numbers of a run with one bar rigid, and one with both flexible."""
    rows = []
    for effects, sides in (PARTS["flexible"], PARTS["one rigid"]):
        scene = bars(*effects, sides=sides, mass=mass, probes={"tip": (2.02, 0.2, 0.2)})
        for r in rf.simulate(scene, 0.01, 0.15):
            rows.append([r.energy, r.kinetic, *r.angular_momentum, *r.probes["tip"]])
    return rows


@NO_WARNINGS
@pytest.mark.parallel
@pytest.mark.parametrize(("ranks", "mass"), [(2, "lumped"), (3, "consistent")])
def test_ranks_find_the_same(ranks, mass):
    """Sides of a joint may be on different ranks."""
    one, several = np.array(history(mass)), np.array(parallel.run(__file__, ranks, 300, mass))
    assert (np.abs(several - one).max(axis=0) <= 1e-9 * np.abs(one).max(axis=0)).all()


if __name__ == "__main__":
    import sys
    import warnings

    warnings.simplefilter("ignore")
    rows = history(sys.argv[1])
    if MPI.COMM_WORLD.rank == 0:
        parallel.report(rows)

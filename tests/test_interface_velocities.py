"""Velocities where flexible cells meet bodies: two of them with a consistent mass, which agree.

Run as a script under mpirun, this file reports how its scenes begin.
"""

import numpy as np
import parallel
import pytest
from histories import EPS
from mpi4py import MPI

import rigidfx as rf

RHO, LENGTH = 2.0, 6
PARTS = {"left": (0, 2), "middle": (3, 4), "right": (5, 6)}
MASS = 7.0  # kg, of a body of given mass
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])


def shear(X):
    """A velocity that is rigid on no part, and of first order in each coordinate."""
    return np.array([0.3 * X[0], 0 * X[0], X[0] * X[2]])


def stretch(X):
    """A velocity that turns nothing."""
    return np.array([0.3 * X[0], 0 * X[0], 0 * X[0]])


def bar(*effects, start=shear, nu=0.3, **options):
    domain = rf.box((0, 0, 0), (LENGTH, 1, 1), (LENGTH, 1, 1))
    for name, (a, b) in PARTS.items():
        domain = domain.with_cells(name, lambda x, a=a, b=b: (x[0] > a - 0.1) & (x[0] < b + 0.1))
    material = rf.StVenantKirchhoff(rho=RHO, E=500.0, nu=nu)
    initial = rf.InitialVelocity(function=start)
    return rf.Scene(domain, material, [*effects, initial], **{"mass": "consistent", **options})


def exact(start, low, high):
    """Energy, L and J of the bar from one x to another at the start, by Gauss's points."""
    points, weights = np.polynomial.legendre.leggauss(3)
    points, weights = (points + 1) / 2, weights / 2
    u, y, z = (g.reshape(-1) for g in np.meshgrid(points, points, points))
    w = np.prod(np.meshgrid(weights, weights, weights), axis=0).reshape(-1) * RHO * (high - low)
    x = np.array([low + (high - low) * u, y, z])
    v = start(x)
    return 0.5 * w @ (v**2).sum(axis=0), v @ w, np.cross(x.T, v.T).T @ w


def first(scene):
    """The report of the initial state, and how far the two sides of interfaces are apart."""
    reports = rf.simulate(scene, 0.1, 0.1)
    report = next(reports)
    gap = report.interface_mismatch
    reports.close()
    return report, gap


def gaps(scene, dt, t_end, **options):
    return [r.interface_mismatch for r in rf.simulate(scene, dt, t_end, **options)]


# How it begins ---------------------------------------------------------------------------------


@pytest.mark.parametrize("names", [["left"], ["right", "left"], ["left", "middle", "right"]])
def test_both_sides_begin_alike(names):
    """Energy, kept energy counted, and momenta are those of the velocity that is given."""
    report, gap = first(bar(*map(rf.Rigid, names)))
    H, L, J = exact(shear, 0, LENGTH)
    assert gap <= 100 * EPS
    assert [body.name for body in report.bodies] == names
    assert report.energy == pytest.approx(H, rel=1e-13)
    assert report.linear_momentum == pytest.approx(L, rel=1e-13, abs=1e-12)
    assert report.angular_momentum == pytest.approx(J, rel=1e-13, abs=1e-12)
    assert all(body.stored > 1e-3 * H for body in report.bodies)


def test_bodies_of_given_mass_have_their_own_momenta():
    """These are no matter of their cells; the others keep what all of it takes out."""
    given = rf.Rigid("right", mass=MASS), rf.Rigid("middle", mass=2 * MASS)
    report, gap = first(bar(given[0], rf.Rigid("left"), given[1]))
    wanted = np.zeros((2, 3))
    for low, high in ((0, 2), (2, 3), (4, 5)):
        wanted += exact(shear, low, high)[1:]
    for (low, high), mass in ((PARTS["right"], MASS), (PARTS["middle"], 2 * MASS)):
        _, L, J = exact(shear, low, high)
        centre = np.array([(low + high) / 2, 0.5, 0.5])
        # its velocities are those of its cells, and so is its inertia
        wanted += mass / RHO * L, J + np.cross(centre, mass / RHO * L - L)
    assert gap <= 100 * EPS
    assert [body.name for body in report.bodies] == ["right", "left", "middle"]
    assert [body.stored > 0 for body in report.bodies] == [False, True, False]
    # What the interfaces take over goes through the bodies: of L and J nothing is lost.
    assert report.linear_momentum == pytest.approx(wanted[0], rel=1e-13, abs=1e-12)
    assert report.angular_momentum == pytest.approx(wanted[1], rel=1e-13, abs=1e-12)


def test_beside_a_support():
    """Its nodes keep their velocity, and energy is kept; the support takes part in momenta."""
    report, gap = first(bar(rf.Rigid("right"), rf.Fixed("x0"), start=shear))
    state = report.state
    held = np.isclose(state.X[:, 0], 0)
    assert gap <= 100 * EPS
    assert np.abs(state.v.x.array.reshape(-1, 3)[held]).max() == 0.0
    assert report.energy == pytest.approx(exact(shear, 0, LENGTH)[0], rel=1e-13)


# How it goes on --------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:.* acts with a jolt")
@pytest.mark.parametrize("effect", [None, rf.Fixed("x0", since=0.2, until=0.4)])
def test_nothing_rings_where_nothing_turns(effect):
    """What steps leave needs a body that turns: this one does not, clamped for a while or not."""
    effects = [rf.Rigid("left"), *([] if effect is None else [effect])]
    found = gaps(bar(*effects, start=stretch, nu=0.0), 0.05, 1.0)
    assert max(found) <= 1e-12


def test_what_steps_leave_is_of_second_order():
    """The two velocities of an interface differ where its body turns, the less the shorter Δt."""
    coarse, fine = (max(gaps(bar(rf.Rigid("left")), dt, 0.2)) for dt in (0.02, 0.01))
    assert 1e-8 < fine < 1e-2
    assert coarse / fine > 3.4


def test_it_is_asked_for_before_the_run_goes_on():
    reports = rf.simulate(bar(rf.Rigid("left")), 0.1, 0.1)
    report = next(reports)
    next(reports)
    with pytest.raises(rf.SceneError, match=r"Report\.interface_mismatch: .* the run has gone on"):
        _ = report.interface_mismatch
    reports.close()


# On several ranks ------------------------------------------------------------------------------


def starts():
    """How scenes begin, and how far the sides of interfaces are apart then and a little later."""
    out = {}
    for name, others in (("left", ()), ("middle", (rf.Rigid("right", mass=MASS),))):
        scene, rows = bar(rf.Rigid(name), *others), []
        for r in rf.simulate(scene, 0.1, 0.2):
            six = np.hstack([r.rigid.velocity, r.rigid.angular_velocity]).reshape(-1)
            rows.append([*six, r.kinetic, r.stored, *r.linear_momentum, *r.angular_momentum])
            rows[-1].append(r.interface_mismatch)
        out[name] = rows
    return out


@pytest.mark.parallel
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its own mpirun")
def test_on_two_ranks():
    several = parallel.run(__file__, 2, timeout=300)
    for name, rows in starts().items():
        assert several[name][0][-1] <= 100 * EPS
        for a, b in zip(several[name], rows, strict=True):
            assert np.abs(np.subtract(a, b)).max() <= 1e-11 * np.abs(b).max(), name


if __name__ == "__main__":
    parallel.report(starts())

"""Enhanced and assumed strains of energies that are not quadratic: forces, conservation, ranks."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import parallel
import pytest
import ufl
from dolfinx import fem
from histories import show
from mpi4py import MPI

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.static_forces import static_forces
from rigidfx.mechanics.rest import rest_moduli

HERE = Path(__file__).resolve().parent
SOFT = rf.NeoHooke(E=1e4, nu=0.3, rho=10.0)
ELEMENTS = {"enhanced": "enhanced", "assumed": rf.AssumedStrains("outside")}
EXACT = 1e-12


def tube(comm=MPI.COMM_SELF):
    """Part of a tube of 3 × 2 × 1 cells, none of which is a parallelepiped."""
    grid = np.stack(np.meshgrid(*(np.linspace(0, 1, k + 1) for k in (3, 2, 1)), indexing="ij"), -1)
    grid[1:-1, 1:-1, :, :2] += np.random.default_rng(3).uniform(-0.1, 0.1, (2, 1, 1, 2))
    a, y, r = 1.2 * grid[..., 0], 1.5 * grid[..., 1], 1.0 + 0.1 * grid[..., 2]
    points = np.stack([r * np.sin(a), y, r * np.cos(a)], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(grid.shape[:3])
    corners = [number[i : i + 3, j : j + 2, k : k + 1].reshape(-1)
               for k in (0, 1) for j in (0, 1) for i in (0, 1)]  # fmt: skip
    cells = np.stack(corners, axis=1)
    if comm.rank:
        points, cells = points[:0], cells[:0]
    domain = rf.from_arrays(points, cells, comm=comm)
    return domain.with_facets("outside", lambda x: np.hypot(x[0], x[2]) > 1.1 - 1e-9)


def damped(until=np.inf):
    """ξ and viscous stresses of both kinds."""
    return [
        rf.NumericalDamping(0.1, until=until),
        rf.KelvinVoigt(30.0, until=until),
        rf.StiffnessDamping(0.05, 1.0, until=until),
    ]


def spin():
    """A turn and a motion that strains by some per cent."""
    return rf.InitialVelocity(
        angular=(0.3, 0.2, 1.0),
        function=lambda X: np.stack([np.sin(3 * X[1]), 0 * X[0], X[0] ** 2]),
    )


@pytest.mark.parametrize("element", ELEMENTS)
def test_forces_are_derivatives_of_the_energy(element):
    """And for small strains those of St.Venant and Kirchhoff's material."""

    def forces(material):
        scene = rf.Scene(tube(), material, element=ELEMENTS[element])
        of = InternalForces(scene, fem.Function(scene.space))
        static, energy = static_forces(scene, of, of.cells()), of.bind_energy(of.cells())

        def at(u):
            of.u1.x.array[:] = of.u0.x.array[:] = u
            f = fem.assemble_vector(static.residual).array.copy()
            return f, fem.assemble_scalar(energy), fem.assemble_matrix(static.interior).to_scipy()

        return at

    at, plain = forces(SOFT), forces(rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0))
    u, d = np.random.default_rng(2).normal(scale=0.02, size=(2, 72))
    h = 1e-5
    (ahead, more, _), (behind, less, _), (f, _, K) = at(u + h * d), at(u - h * d), at(u)
    assert f @ d == pytest.approx((more - less) / (2 * h), rel=1e-7)
    change = (ahead - behind) / (2 * h)
    np.testing.assert_allclose(K @ d, change, atol=1e-7 * np.abs(change).max())
    assert abs(K - K.T).max() < EXACT * abs(K).max()
    small, expected = at(1e-7 * u)[0], plain(1e-7 * u)[0]
    np.testing.assert_allclose(small, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("element", ["assumed"])  # test_elements has the enhanced ones
def test_a_damped_start_free_flight_and_a_cycle(element):
    """Energy, momenta and what is dissipated, through a freeze and a release; all tangents."""
    scene = rf.Scene(tube(), SOFT, [spin(), *damped(0.2)], element=ELEMENTS[element])
    criterion = rf.StrainRate(
        1e9, 0.1, patience=1, since=0.3, release=rf.Release(at=[0.6]), until=0.5
    )
    reports = list(rf.simulate(scene, 0.02, 0.8, rigidify=criterion))
    assert [e.kind for r in reports for e in r.events] == ["freeze", "release"]
    H = np.array([r.energy for r in reports])
    lost = np.array([sum(r.dissipated.values()) for r in reports])
    J = np.array([r.angular_momentum for r in reports])
    L = np.array([r.linear_momentum for r in reports])
    scale = max(r.momentum_scale for r in reports)
    found = {
        "H": np.abs(H - H[0] + np.cumsum(lost)).max() / H[0],
        "J": np.abs(J - J[0]).max() / np.abs(J[0]).max(),
        "L": np.abs(L - L[0]).max() / scale,
        "lost": lost.sum() / H[0],
        "strain": max(r.strain for r in reports) / H[0],
    }
    show(**found)
    assert found["strain"] > 0.02
    assert found["lost"] > 0.01
    assert max(found[k] for k in "HJL") < 1e-11


@pytest.mark.parametrize("element", ELEMENTS)
def test_tangent_of_a_step_is_the_derivative_of_its_residual(element):
    """With a discrete gradient, ξ and viscous stresses of both kinds."""
    scene = rf.Scene(tube(), SOFT, damped(), element=ELEMENTS[element])
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0, acting=[scene.effects])
    forces.set_time(0.0, 0.1)
    bound = forces.bind(forces.cells())
    x0, x1, d = np.random.default_rng(1).normal(scale=0.02, size=(3, u0.x.array.size))

    def residual(x):
        forces.u1.x.array[:] = x
        return fem.assemble_vector(bound.residual).array.copy()

    u0.x.array[:] = x0
    h = 1e-5
    change = (residual(x1 + h * d) - residual(x1 - h * d)) / (2 * h)
    residual(x1)
    K = fem.assemble_matrix(bound.interior).to_scipy()
    np.testing.assert_allclose(K @ d, change, atol=1e-7 * np.abs(change).max())


def test_moduli_at_rest():
    """Of formulas; of an energy with a direction those of its mean over all directions."""

    def fibres(C, mu, k):
        return (
            mu * ufl.inner(C - ufl.Identity(3), C - ufl.Identity(3)) / 4
            + k * (C[0, 0] - 1) ** 2 / 8
        )

    assert rest_moduli(SOFT) == pytest.approx((1e4 * 0.3 / 1.3 / 0.4, 1e4 / 2.6))
    stiff = rf.MooneyRivlin(c10=1.0, c01=2.0, kappa=30.0, rho=1.0)
    assert rest_moduli(stiff) == pytest.approx((26.0, 6.0))
    lam, mu = rest_moduli(rf.Hyperelastic(rho=1.0, W=fibres, values={"mu": 2.0, "k": 15.0}))
    assert (lam, mu) == pytest.approx((1.0, 3.0))  # k/15 each beside μ


@cache
def _histories(ranks):
    return np.array(parallel.run(HERE / "projected_on_ranks.py", ranks, 300))


@parallel.on_1_and_3_ranks
def test_ranks_agree(ranks):
    """Energy and momenta, beside a body."""
    one, more = _histories(1), _histories(ranks)
    assert np.abs(more - one).max() <= 1e-10 * np.abs(one).max()

"""Assumed strains of thin cells: second program, patch test, rigid motion, conservation, shells."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import parallel
import pytest
from dolfinx import fem
from histories import show
from mpi4py import MPI
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation
from test_enhanced import MATERIAL, SPIN, Forces, drifts, imbalance

import rigidfx as rf
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.domain.thickness import thickness_axes
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.stress import CauchyStress

HERE = Path(__file__).resolve().parent
EXACT = 1e-12
ANY = 1e9  # a tolerance under which everything is rigid


def bent(n=(4, 3, 1), comm=MPI.COMM_SELF, turned=0, by=0.1):
    """Part of a tube, 0.1 m thick; its cells' corners begin anywhere; "outside" and "rim" named."""
    random = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*(np.linspace(0, 1, k + 1) for k in n), indexing="ij"), axis=-1)
    inner = np.s_[1:-1, 1:-1] if min(n[:2]) > 1 else np.s_[:0, :0]
    grid[inner][..., :2] += random.uniform(-by, by, grid[inner][..., :1, :2].shape)
    a, y, r = 1.2 * grid[..., 0], 1.5 * grid[..., 1], 1.0 + 0.1 * grid[..., 2]
    points = np.stack([r * np.sin(a), y, r * np.cos(a)], axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(grid.shape[:3])
    order = [(0, 1, 2), (1, 2, 0), (2, 0, 1)][turned]  # which of the cell's coordinates is which
    shifts = [np.eye(3, dtype=int)[:, list(order)] @ (k & 1, k >> 1 & 1, k >> 2) for k in range(8)]
    cells = np.stack(
        [number[i : i + n[0], j : j + n[1], k : k + n[2]].reshape(-1) for i, j, k in shifts], axis=1
    )
    if comm.rank:
        points, cells = points[:0], cells[:0]
    domain = rf.from_arrays(points, cells, comm=comm)
    domain = domain.with_facets("outside", lambda x: np.hypot(x[0], x[2]) > 1.1 - 1e-9)
    return domain.with_facets("rim", lambda x: x[1] < 1e-9)


def scene_of(domain, *effects, thickness="outside", **options):
    return rf.Scene(domain, MATERIAL, effects, element=rf.AssumedStrains(thickness), **options)


# The cell ----------------------------------------------------------------------------------------


def slopes(at):
    """Derivatives of shape functions by coordinates from -1 to 1, shape (8, 3)."""
    corners = np.array([[2 * (n >> k & 1) - 1 for k in range(3)] for n in range(8)])
    factors = (1 + corners * at) / 2
    return np.stack(
        [corners[:, k] / 2 * np.delete(factors, k, axis=1).prod(axis=1) for k in range(3)], axis=1
    )


def plain(X, u, lam, mu):
    """Stored energy of a cell that is thin along its third coordinate, as the equations stand."""

    def natural(at):
        G, g = X.T @ slopes(at), (X + u).T @ slopes(at)
        return (g.T @ g - G.T @ G) / 2

    J0 = X.T @ slopes((0, 0, 0))
    weights, strains, modes = [], [], []
    for x, y, z in (np.array(np.unravel_index(range(8), (2, 2, 2))).T * 2 - 1) / np.sqrt(3):
        J = X.T @ slopes((x, y, z))
        E = natural((x, y, z))
        E[0, 2] = E[2, 0] = sum((1 + s * y) / 2 * natural((0, s, 0))[0, 2] for s in (-1, 1))
        E[1, 2] = E[2, 1] = sum((1 + s * x) / 2 * natural((s, 0, 0))[1, 2] for s in (-1, 1))
        E[2, 2] = sum(
            (1 + s * x) * (1 + t * y) / 4 * natural((s, t, 0))[2, 2]
            for s in (-1, 1)
            for t in (-1, 1)
        )
        K, K0 = np.linalg.inv(J), np.linalg.inv(J0)
        strains.append(K.T @ E @ K)
        here = []
        values = [
            (0, 0, x),
            (1, 1, y),
            (0, 1, x),
            (0, 1, y),
            (2, 2, z),
            (2, 2, x * z),
            (2, 2, y * z),
        ]
        for i, j, value in values:
            unit = np.zeros((3, 3))
            unit[i, j] = unit[j, i] = value
            here.append(np.linalg.det(J0) / np.linalg.det(J) * K0.T @ unit @ K0)
        modes.append(here)
        weights.append(np.linalg.det(J))
    w, E, M = np.abs(weights), np.array(strains), np.array(modes)

    def stress(A):
        return lam * np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) + 2 * mu * A

    D = np.einsum("p,pmij,pnij->mn", w, stress(M), M)
    alpha = -np.linalg.solve(D, np.einsum("p,pmij,pij->m", w, stress(M), E))
    E = E + np.einsum("m,pmij->pij", alpha, M)
    return np.einsum("p,pij,pij->", w, stress(E), E) / 2


@pytest.mark.parametrize("turned", [0, 1, 2])
def test_energy_is_that_of_the_equations(turned):
    """By a second program, whichever of a cell's coordinates is the one across."""
    scene = scene_of(bent(turned=turned))
    forces, rng = Forces(scene), np.random.default_rng(1)
    X = scene.space.tabulate_dof_coordinates()
    u = rng.normal(scale=0.02, size=X.shape)
    lam, mu = MATERIAL.parameters["lmbda"], MATERIAL.parameters["mu"]
    axes = thickness_axes(scene.domain, "outside")
    expected = 0.0
    for nodes, axis in zip(scene.space.dofmap.list, axes, strict=True):
        shape = nodes.reshape(2, 2, 2).transpose(2, 1, 0)  # by the three coordinates
        nodes = np.moveaxis(shape, axis - 1, 2).transpose(2, 1, 0).reshape(-1)
        expected += plain(X[nodes], u[nodes], lam, mu)
    assert forces.energy(u) == pytest.approx(expected, rel=1e-12)


def test_forces_and_tangents_are_derivatives():
    """Of the energy, and of the forces."""
    scene = scene_of(bent())
    forces, rng = Forces(scene), np.random.default_rng(2)
    u, d = rng.normal(scale=0.02, size=(2, forces.u0.x.array.size))
    h = 1e-6
    f = forces.at(u)
    slope = (forces.energy(u + h * d) - forces.energy(u - h * d)) / (2 * h)
    assert f @ d == pytest.approx(slope, rel=1e-7)
    change = (forces.at(u + h * d) - forces.at(u - h * d)) / (2 * h)
    K = forces.tangent(u)
    np.testing.assert_allclose(K @ d, change, atol=1e-7 * np.abs(change).max())
    assert abs(K - K.T).max() < EXACT * abs(K).max()


@pytest.mark.parametrize("damped", [False, True])
def test_tangent_of_a_step_is_the_derivative_of_its_residual(damped):
    """With and without ξ and both viscous stresses; some cells thin, some not."""
    effects = [rf.KelvinVoigt(30.0), rf.StiffnessDamping(0.1, 1.0), rf.NumericalDamping(0.1)]
    effects = effects if damped else []
    domain = bent().with_facets(
        "some", lambda x: (np.hypot(x[0], x[2]) > 1.1 - 1e-9) & (x[0] < 0.7)
    )
    scene = scene_of(domain, *effects, thickness="some")
    assert set(thickness_axes(domain, "some")) == {0, 3}
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0, acting=[effects])
    forces.set_time(0.0, 0.1)
    bound = forces.bind(forces.cells())
    x0, x1, d = np.random.default_rng(1).normal(scale=0.02, size=(3, u0.x.array.size))

    def residual(x):
        forces.u1.x.array[:] = x
        return fem.assemble_vector(bound.residual).array.copy()

    u0.x.array[:] = x0
    h = 1e-6
    change = (residual(x1 + h * d) - residual(x1 - h * d)) / (2 * h)
    residual(x1)
    K = fem.assemble_matrix(bound.interior).to_scipy()
    np.testing.assert_allclose(K @ d, change, atol=1e-7 * np.abs(change).max())


def test_patch():
    """Any constant strain of prisms with any quadrilateral as base is found, with its energy."""
    n = 3
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2, indexing="ij"), axis=-1)
    grid[1:-1, 1:-1] += np.random.default_rng(5).uniform(-0.1, 0.1, (n - 1, n - 1, 2))
    points = np.concatenate([np.dstack([grid, np.full(grid.shape[:2], z)]).reshape(-1, 3)
                             for z in (0.0, 0.05, 0.1)])  # fmt: skip
    number = np.arange(len(points)).reshape(3, n + 1, n + 1)
    cells = np.stack([number[k : k + 2, i : i + n, j : j + n].reshape(-1)
                      for k in (0, 1) for j in (0, 1) for i in (0, 1)], axis=1)  # fmt: skip
    domain = rf.from_arrays(points, cells, comm=MPI.COMM_SELF)
    scene = scene_of(domain.with_facets("top", lambda x: x[2] > 0.1 - 1e-9), thickness="top")
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    G = np.random.default_rng(4).normal(scale=1e-2, size=(3, 3))
    u = X @ G.T
    f = forces.at(u)
    outside = np.any((X < 1e-9) | (np.array([1.0, 1.0, 0.1]) - 1e-9 < X), axis=1).repeat(3)
    assert np.abs(f[~outside]).max() < EXACT * np.abs(f).max()
    K = forces.tangent(0 * u)
    inner = np.flatnonzero(~outside)
    found = spsolve(K[inner][:, inner].tocsc(), -(K @ (u.reshape(-1) * outside))[inner])
    np.testing.assert_allclose(found, u.reshape(-1)[inner], atol=EXACT)
    E = (G + G.T + G.T @ G) / 2
    lam, mu = MATERIAL.parameters["lmbda"], MATERIAL.parameters["mu"]
    W = lam / 2 * np.trace(E) ** 2 + mu * np.vdot(E, E)
    assert forces.energy(u) == pytest.approx(W * 0.1, rel=EXACT)


def test_rigid_motions_strain_nothing_and_nothing_else_is_free():
    """Six eigenvalues are zero; energy and forces turn with what turns."""
    scene = scene_of(bent())
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    K = forces.tangent(0 * X).toarray()
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:6]).max() < 1e-11 * values[-1]
    assert values[6] > 1e-7 * values[-1]
    R = Rotation.from_rotvec([0.7, -1.1, 2.0]).as_matrix()
    scale = np.abs(forces.at(0.01 * X)).max() / 0.01
    assert np.abs(forces.at(X @ R.T - X)).max() < 1e-13 * scale
    u = np.random.default_rng(5).normal(scale=0.01, size=X.shape)
    turned = (X + u) @ R.T - X
    assert forces.energy(turned) == pytest.approx(forces.energy(u), rel=1e-11)
    np.testing.assert_allclose(
        forces.at(turned).reshape(-1, 3), forces.at(u).reshape(-1, 3) @ R.T, atol=EXACT * scale
    )


def test_rank_of_a_cell():
    """One cell has six motions without energy."""
    scene = scene_of(bent((1, 1, 1)))
    K = Forces(scene).tangent(np.zeros(24)).toarray()
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:6]).max() < EXACT * values[-1] < 1e-6 * values[6]


# A shell -----------------------------------------------------------------------------------------


def hemisphere(element, n):
    """MacNeal and Harder's: R = 10 m, t = 0.04 m, a hole of 18°, pinched; over 0.0930 m."""
    t, lines = 0.04, [np.linspace(0, 1, k + 1) for k in (1, n, n)]
    c, b, a = np.meshgrid(*lines, indexing="ij")
    phi, theta, r = a * np.pi / 2, b * np.radians(72.0), 10 + t * (c - 0.5)
    flat = r * np.cos(theta)
    points = np.stack([flat * np.cos(phi), flat * np.sin(phi), r * np.sin(theta)], axis=-1)
    number = np.arange(c.size).reshape(c.shape)
    cells = np.stack([number[k : k + 1, j : j + n, i : i + n].reshape(-1)
                      for k in (0, 1) for j in (0, 1) for i in (0, 1)], axis=1)  # fmt: skip
    domain = rf.from_arrays(points.reshape(-1, 3), cells, comm=MPI.COMM_SELF)
    domain = domain.with_facets("out", lambda x: np.linalg.norm(x, axis=0) > 10 + 0.4 * t)
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=6.825e7, nu=0.3, rho=1.0), element=element)
    X = scene.space.tabulate_dof_coordinates()
    on_x, on_y, low = (np.abs(X[:, k]) < 1e-9 for k in (1, 0, 2))
    held = np.stack([on_y, on_x, on_x & low & (X[:, 0] < 10)], axis=1).reshape(-1)
    A, B = on_x & low, on_y & low
    f = np.zeros(X.shape)
    f[A, 0], f[B, 1] = -0.5, 0.5
    K = Forces(scene).tangent(0 * X)
    free, u = np.flatnonzero(~held), np.zeros(f.size)
    u[free] = spsolve(K[free][:, free].tocsc(), f.reshape(-1)[free])
    return -u.reshape(-1, 3)[A, 0].mean() / 0.0930


def test_a_pinched_hemisphere_does_not_lock():
    """8 × 8 cells: within 2 %, three quarters with enhanced strains alone."""
    found = {"assumed": rf.AssumedStrains("out"), "enhanced": "enhanced"}
    found = {name: hemisphere(element, 8) for name, element in found.items()}
    show(**found)
    assert found["assumed"] == pytest.approx(1.0, abs=0.02)
    assert found["enhanced"] == pytest.approx(0.75, abs=0.02)


# Dynamics ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_free_flight_and_a_cycle(mass):
    """H, L and J stay while it flies, is frozen, turns by a radian, and is released, twice."""
    criterion = rf.StrainRate(ANY, 0.2, release=rf.Release(at=[1.0, 2.0]), until=1.5)
    stress = CauchyStress(scene := scene_of(bent(), SPIN, mass=mass))
    reports, sizes = [], []
    for r in rf.simulate(scene, 0.02, 2.4, rigidify=criterion):
        reports.append(r)
        if r.unknowns == 6:
            sizes.append(np.linalg.norm(stress.measure(r.state.u), axis=(1, 2)))
    found = drifts(reports)
    show(**found, strain=max(r.strain for r in reports) / reports[0].energy)
    assert max(r.strain for r in reports) > 0.02 * reports[0].energy
    assert max(found.values()) < 1e-11
    assert sum(e.kind == "release" for r in reports for e in r.events) == 2
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=1e-9)
    assert sizes[0].min() > 0


def test_damping_takes_what_it_says():
    """ξ and both viscosities under a pressure; none of them ever gives energy."""
    damping = [rf.NumericalDamping(0.1), rf.KelvinVoigt(40.0), rf.StiffnessDamping(0.05, 2.0)]
    scene = scene_of(bent(), SPIN, *damping, rf.Pressure("outside", 3.0))
    reports = list(rf.simulate(scene, 0.02, 0.6))
    assert imbalance(reports) < 1e-12
    for effect in damping:
        lost = [r.dissipated[effect.kind] for r in reports[1:]]
        assert min(lost) > 0


def test_bodies_wake_beside_assumed_strains():
    """Shadows have the stiffness and the viscosity of thin cells."""
    domain = rf.box((0, 0, 0), (8, 1, 0.5), (8, 1, 1), comm=MPI.COMM_SELF)
    push = rf.Traction("x1", (0, 0, 4.0), time=rf.Table((0, 1, 2, 8), (0, 1, 0, 0)))
    criterion = rf.StrainRate(tol=6e-3, window=0.5, wake="local", patience=1.0)
    effects = rf.Fixed("x0"), push, rf.KelvinVoigt(10.0)
    reports = list(
        rf.simulate(scene_of(domain, *effects, thickness="z1"), 0.05, 6.0, rigidify=criterion)
    )
    assert any(e.kind == "freeze" for r in reports for e in r.events)
    assert any(np.size(e.woken) for r in reports for e in r.events)
    assert imbalance(reports) < 1e-11


@cache
def _histories(ranks):
    return [np.array(a) for a in parallel.run(HERE / "assumed_on_ranks.py", ranks, 300)]


@parallel.on_1_to_3_ranks
def test_ranks_agree(ranks):
    """On which way cells are thin, through three layers, and on histories with a body."""
    (axes, found), (expected, alone) = _histories(ranks), _histories(1)
    np.testing.assert_array_equal(axes, expected)
    scale = np.abs(alone).max(axis=0)
    np.testing.assert_allclose(found / scale, alone / scale, atol=1e-10)


# Refusals ----------------------------------------------------------------------------------------


def test_the_thickness_goes_on_through_layers():
    """From one side of three layers to the other, and no farther than the named part."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 3), comm=MPI.COMM_SELF)
    domain = domain.with_facets("half", lambda x: (x[2] > 1 - 1e-9) & (x[0] < 2 + 1e-9))
    middles = domain.mesh.geometry.x[cell_geometry_dofs(domain.mesh)].mean(axis=1)
    np.testing.assert_array_equal(thickness_axes(domain, "half"), np.where(middles[:, 0] < 2, 3, 0))


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"thickness": "no"}, "AssumedStrains: there are no facets named 'no'"),
        ({"thickness": "corner"}, "thickness goes two ways"),
        ({"thickness": 3}, "name of a surface.*got 3"),
        ({"order": 2}, "element=AssumedStrains is for order 1, got order 2"),
        ({"material": rf.NeoHooke(E=1e4, nu=0.3, rho=1.0)}, "StVenantKirchhoff.*got NeoHooke"),
        ({"scheme": rf.Midpoint()}, "goes with EnergyMomentum, not with Midpoint"),
        ({"cell": "tetrahedron"}, "is for hexahedra"),
    ],
)
def test_what_cannot_be_is_refused(options, found):
    options = {"thickness": "z1", "cell": "hexahedron", "material": MATERIAL} | options
    domain = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), options.pop("cell"))
    domain = domain.with_facets("corner", lambda x: (x[2] > 1 - 1e-9) | (x[0] > 1 - 1e-9))
    with pytest.raises(rf.SceneError, match=found):
        rf.Scene(
            domain,
            options.pop("material"),
            element=rf.AssumedStrains(options.pop("thickness")),
            **options,
        )

"""Enhanced strains: patch test, rigid motion, conservation, bending, refusals."""

from __future__ import annotations

import gc
from functools import cache
from pathlib import Path

import basix
import dolfinx.mesh as dmesh
import numpy as np
import parallel
import pytest
import ufl
from dolfinx import fem
from histories import show
from mpi4py import MPI
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.flexible.elimination import alive
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.strain_rate import StrainRates
from rigidfx.flexible.stress import CauchyStress

HERE = Path(__file__).resolve().parent
MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
EXACT = 1e-12
ANY = 1e9  # a tolerance under which everything is rigid


def _waves(X):
    return np.stack([np.sin(2 * X[1] + X[0]), 0.7 * X[0] - 2, X[1] * X[0] - 2 * X[2]])


SPIN = rf.InitialVelocity(angular=(0.3, 0.2, 1.0), function=_waves)


def distorted(n=(3, 2, 2), size=(1.5, 1.0, 0.6), by=0.07):
    """A box whose inner nodes are anywhere."""
    x, y, z = (np.linspace(0, s, k + 1) for s, k in zip(size, n, strict=True))
    points = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    inner = np.all((points > 1e-9) & (points < np.array(size) - 1e-9), axis=1)
    rng = np.random.default_rng(3)
    points[inner] += rng.uniform(-by, by, (inner.sum(), 3))
    nx, ny = n[0] + 1, n[1] + 1
    number = np.arange(len(points)).reshape(n[2] + 1, ny, nx)
    corners = [number[k : k + n[2], j : j + n[1], i : i + n[0]].reshape(-1)
               for k in (0, 1) for j in (0, 1) for i in (0, 1)]  # fmt: skip
    return rf.from_arrays(points, np.stack(corners, axis=1), comm=MPI.COMM_SELF)


def scene_of(domain, *effects, **options):
    return rf.Scene(domain, MATERIAL, effects, element="enhanced", **options)


class Forces:
    """Static forces and tangent of a scene at displacements, shape (nodes, 3)."""

    def __init__(self, scene):
        self.scene = scene
        self.u0 = fem.Function(scene.space)
        self.of = InternalForces(scene, self.u0)
        self.cells = self.of.cells()
        self.static = self.of.bind_static(self.cells)

    def at(self, u):
        self.of.u1.x.array[:] = u.reshape(-1)
        return fem.assemble_vector(self.static.residual).array.copy()

    def tangent(self, u):
        self.of.u1.x.array[:] = u.reshape(-1)
        return fem.assemble_matrix(self.static.interior).to_scipy().tocsr()

    def energy(self, u):
        self.u0.x.array[:] = u.reshape(-1)
        return fem.assemble_scalar(self.of.bind_energy(self.cells))


# The cell ----------------------------------------------------------------------------------------


def _plain(corners, u, lam, mu):
    """Stored energy of a cell, α from the equations as they stand."""
    rule, weights = basix.make_quadrature(basix.CellType.hexahedron, 2)
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.hexahedron, 1)
    dN = element.tabulate(1, np.vstack([rule, [[0.5] * 3]]))[1:, :, :, 0].transpose(1, 2, 0)
    J = np.einsum("ni,pnk->pik", corners, dN)
    J0, J = J[-1], J[:-1]
    K0, j0, j = np.linalg.inv(J0), np.linalg.det(J0), np.linalg.det(J)
    H = np.einsum("ni,pnk,pkj->pij", u, dN[:-1], np.linalg.inv(J))
    E = (H + H.swapaxes(1, 2) + H.swapaxes(1, 2) @ H) / 2
    modes = {
        (0, 0): "x xy xz", (1, 1): "y xy yz", (2, 2): "z xz yz",
        (0, 1): "x y xz yz", (1, 2): "y z xy xz", (0, 2): "x z xy yz",
    }  # fmt: skip
    M = []
    for (a, b), products in modes.items():
        for product in products.split():
            unit = np.zeros((3, 3))
            unit[a, b] = unit[b, a] = 1.0
            value = np.prod([2 * rule[:, "xyz".index(c)] - 1 for c in product], axis=0)
            M.append((value * j0 / j)[:, None, None] * (K0.T @ unit @ K0))
    M = np.array(M)

    def stress(A):
        return lam * np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) + 2 * mu * A

    w = weights * j
    D = np.einsum("p,mpij,npij->mn", w, stress(M), M)
    alpha = -np.linalg.solve(D, np.einsum("p,mpij,pij->m", w, stress(M), E))
    enhanced = E + np.einsum("m,mpij->pij", alpha, M)
    return np.einsum("p,pij,pij->", w, stress(enhanced), enhanced) / 2


def test_energy_of_a_distorted_cell_is_that_of_the_equations():
    """By a second program, in NumPy, which does none of the short cuts."""
    scene = scene_of(distorted((2, 2, 2)))
    forces, rng = Forces(scene), np.random.default_rng(1)
    X = scene.space.tabulate_dof_coordinates()
    u = rng.normal(scale=0.1, size=X.shape)
    lam, mu = MATERIAL.parameters["lmbda"], MATERIAL.parameters["mu"]
    expected = sum(_plain(X[nodes], u[nodes], lam, mu) for nodes in scene.space.dofmap.list)
    assert forces.energy(u) == pytest.approx(expected, rel=1e-12)


def test_forces_and_tangents_are_derivatives():
    """Of the energy, and of the forces."""
    scene = scene_of(distorted())
    forces, rng = Forces(scene), np.random.default_rng(2)
    u, d = rng.normal(scale=0.05, size=(2, forces.u0.x.array.size))
    h = 1e-5
    f = forces.at(u)
    slope = (forces.energy(u + h * d) - forces.energy(u - h * d)) / (2 * h)
    assert f @ d == pytest.approx(slope, rel=1e-7)
    change = (forces.at(u + h * d) - forces.at(u - h * d)) / (2 * h)
    K = forces.tangent(u)
    np.testing.assert_allclose(K @ d, change, atol=1e-7 * np.abs(change).max())
    assert abs(K - K.T).max() < EXACT * abs(K).max()


@pytest.mark.parametrize("kind", ["plain", "damped"])
def test_tangent_of_a_step_is_the_derivative_of_its_residual(kind):
    """With and without ξ and a viscous stress, whose modes are its own."""
    effects = [rf.KelvinVoigt(30.0), rf.NumericalDamping(0.1)] if kind == "damped" else []
    scene = scene_of(distorted(), *effects)
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0, acting=[effects])
    forces.set_time(0.0, 0.1)
    bound = forces.bind(forces.cells())
    x0, x1, d = np.random.default_rng(1).normal(scale=0.05, size=(3, u0.x.array.size))

    def residual(x):
        forces.u1.x.array[:] = x
        return fem.assemble_vector(bound.residual).array.copy()

    u0.x.array[:] = x0
    h = 1e-5
    change = (residual(x1 + h * d) - residual(x1 - h * d)) / (2 * h)
    residual(x1)
    K = fem.assemble_matrix(bound.interior).to_scipy()
    np.testing.assert_allclose(K @ d, change, atol=1e-8 * np.abs(change).max())


def test_patch():
    """Any constant strain of distorted cells is found inside, and its energy is exact."""
    scene = scene_of(distorted((3, 3, 3), (1.0, 1.1, 0.9), 0.1))
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    G = np.random.default_rng(4).normal(scale=1e-2, size=(3, 3))
    u = X @ G.T
    f = forces.at(u)
    outside = np.any((X < 1e-9) | (np.array([1.0, 1.1, 0.9]) - 1e-9 < X), axis=1).repeat(3)
    assert np.abs(f[~outside]).max() < EXACT * np.abs(f).max()
    K = forces.tangent(0 * u)
    held = u.reshape(-1) * outside
    inner = np.flatnonzero(~outside)
    found = spsolve(K[inner][:, inner].tocsc(), -(K @ held)[inner])
    np.testing.assert_allclose(found, u.reshape(-1)[inner], atol=EXACT)
    E = (G + G.T + G.T @ G) / 2
    lam, mu = MATERIAL.parameters["lmbda"], MATERIAL.parameters["mu"]
    W = lam / 2 * np.trace(E) ** 2 + mu * np.vdot(E, E)
    assert forces.energy(u) == pytest.approx(W * 0.99, rel=EXACT)


def test_rotations_strain_nothing():
    """Nor do they change the energy of what is strained."""
    scene = scene_of(distorted())
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    R = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    scale = np.abs(forces.at(0.1 * X)).max()
    assert np.abs(forces.at(X @ R.T - X)).max() < 1e-13 * scale
    u = np.random.default_rng(5).normal(scale=0.03, size=X.shape)
    turned = (X + u) @ R.T - X
    assert forces.energy(turned) == pytest.approx(forces.energy(u), rel=EXACT)
    np.testing.assert_allclose(
        forces.at(turned).reshape(-1, 3), forces.at(u).reshape(-1, 3) @ R.T, atol=EXACT * scale
    )


# Bending -----------------------------------------------------------------------------------------


def tip(element, nu=0.0, cells=(10, 1, 1), order=1):
    """Deflection of a clamped bar of 10 × 1 × 0.1 m under a force at its end, over theory."""
    material = rf.StVenantKirchhoff(E=1e6, nu=nu, rho=1.0)
    with pytest.warns(rf.RigidfxWarning) if element == "standard" else _nothing():
        scene = rf.Scene(
            rf.box((0, 0, 0), (10, 1, 0.1), cells, comm=MPI.COMM_SELF), material,
            order=order, element=element,
        )  # fmt: skip
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    K = forces.tangent(0 * X)
    f = np.zeros(X.shape)
    f[:, 2] = scene.facet_weights("x1", "test")
    free = np.flatnonzero((X[:, 0] > 1e-9).repeat(3))
    u = np.zeros(f.size)
    u[free] = spsolve(K[free][:, free].tocsc(), f.reshape(-1)[free])
    end = X[:, 0] > 10 - 1e-9
    theory = 0.1 * 10**3 / (3 * 1e6 * 0.1**3 / 12)  # the force is 1 Pa times 0.1 m²
    return u.reshape(-1, 3)[end, 2].mean() / theory


class _nothing:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return False


def test_bending_does_not_lock():
    """Ten cells, ten times as long as thick: theory by enhanced strains, 2 % of it without."""
    enhanced, standard = tip("enhanced"), tip("standard")
    show(enhanced=enhanced, standard=standard)
    assert enhanced == pytest.approx(1.0, abs=0.01)
    assert standard < 0.03


# Dynamics ----------------------------------------------------------------------------------------


def imbalance(reports):
    """Largest |ΔH - work + dissipation| of a step over the largest H."""
    H = np.array([r.energy for r in reports])
    given = [r.work_of_loads + r.work_of_supports - sum(r.dissipated.values()) for r in reports]
    return np.abs(np.diff(H) - given[1:]).max() / H.max()


def drifts(reports):
    """Of energy and both momenta, relative to the first and to what they are compared with."""
    first, scale = reports[0], max(r.momentum_scale for r in reports)
    return {
        "H": max(abs(r.energy / first.energy - 1) for r in reports),
        "L": max(np.abs(r.linear_momentum - first.linear_momentum).max() for r in reports) / scale,
        "J": max(np.abs(r.angular_momentum - first.angular_momentum).max() for r in reports)
        / np.abs(first.angular_momentum).max(),
    }


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_free_flight_of_distorted_cells(mass):
    """H, L and J stay, at strains of several per cent."""
    reports = list(rf.simulate(scene_of(distorted(), SPIN, mass=mass), 0.02, 4.0))
    found = drifts(reports)
    show(**found, strain=max(r.strain for r in reports) / reports[0].energy)
    assert max(r.strain for r in reports) > 0.02 * reports[0].energy
    assert max(found.values()) < 1e-11


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_a_cycle_gives_everything_back(mass):
    """Twice frozen, turned by a radian, released: H, L and J stay, and so does the strain."""
    criterion = rf.StrainRate(ANY, 0.2, release=rf.Release(at=[1.0, 2.0]), until=1.5)
    stress = CauchyStress(scene := scene_of(distorted(), SPIN, mass=mass))
    reports, frozen, sizes = [], [], []
    for r in rf.simulate(scene, 0.02, 2.4, rigidify=criterion):
        reports.append(r)
        frozen.append(r.unknowns == 6)
        if frozen[-1]:
            sizes.append(np.linalg.norm(stress.measure(r.state.u), axis=(1, 2)))
    found = drifts(reports)
    show(**found, share=np.mean(frozen))
    assert max(found.values()) < 1e-11
    assert sum(e.kind == "release" for r in reports for e in r.events) == 2
    # a turned body keeps the size of its stresses
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=1e-10)
    assert sizes[0].min() > 0


def test_damping_takes_what_it_says():
    """ξ and viscosity, without and with a pressure; neither ever gives energy."""
    damping = [rf.NumericalDamping(0.1), rf.KelvinVoigt(40.0)]
    for effects in (damping, [*damping, rf.Pressure("z1", 30.0)]):
        domain = rf.box((0, 0, 0), (4, 1, 0.5), (5, 2, 1), comm=MPI.COMM_SELF)
        reports = list(rf.simulate(scene_of(domain, SPIN, *effects), 0.02, 1.0))
        assert imbalance(reports) < 1e-12
        for kind in ("NumericalDamping", "KelvinVoigt"):
            lost = [r.dissipated[kind] for r in reports[1:]]
            assert min(lost) > 0
            assert sum(lost) > 1e-3 * reports[0].energy


def test_viscosity_does_not_lock():
    """A bar that bends loses what theory says: with strains of cells as they are it were 50 times.

    A mode of frequency ω and viscous modulus η decays by exp(-ηω²t/E): ν = 0.
    """
    E, eta, h, length = 1e6, 200.0, 0.1, 4.0
    beat = 1.875104**2 * np.sqrt(E * h**2 / 12 / 1.0) / length**2

    def shape(X):
        s = 1.875104 * X[0] / length
        a = 0.734096
        phi = np.cosh(s) - np.cos(s) - a * (np.sinh(s) - np.sin(s))
        return np.stack([0 * phi, 0 * phi, 0.01 * phi])

    scene = rf.Scene(
        rf.box((0, 0, 0), (length, 1, h), (8, 1, 1), comm=MPI.COMM_SELF),
        rf.StVenantKirchhoff(E=E, nu=0.0, rho=1.0),
        [rf.Fixed("x0"), rf.InitialVelocity(function=shape), rf.KelvinVoigt(eta)],
        element="enhanced",
    )
    end = 8 * np.pi / beat
    reports = list(rf.simulate(scene, end / 400, end))
    kept = np.log(reports[-1].energy / reports[0].energy)
    # η ΔE:ΔE counts E₁₁ alone where ν = 0, as E does in the stored energy.
    theory = -eta / E * beat**2 * end
    show(kept=kept, theory=theory)
    assert kept == pytest.approx(theory, rel=0.05)


def test_strain_rates_and_stresses_are_those_of_the_enhanced_strain():
    """Pure bending of a thin cell: curvature strains by κz, and nothing shears."""
    scene = scene_of(rf.box((0, 0, 0), (1, 1, 0.1), (1, 1, 1), comm=MPI.COMM_SELF))
    forces = InternalForces(scene, fem.Function(scene.space))
    rates = StrainRates(scene, forces, "rms")
    rates.bind(forces.cells())
    X = scene.space.tabulate_dof_coordinates()
    kappa = 1e-6
    # the corners' part of a bent cell: its end faces turn, its middle does not bulge
    u = np.zeros(X.shape)
    u[:, 0] = kappa * (X[:, 0] - 0.5) * (X[:, 2] - 0.05)
    forces.u1.x.array[:] = u.reshape(-1)
    # E₁₁ = κz, E₂₂ = 0 in the mean of z only as corners see it, E₃₃ = -ν/(1-ν) κz: no shear
    nu = MATERIAL.nu
    z = 0.05 / np.sqrt(3)
    expected = kappa * z * np.sqrt(1 + nu**2 + nu**2)
    assert rates.measure(1.0)[0] == pytest.approx(expected, rel=0.05)


@cache
def _histories(ranks):
    return np.array(parallel.run(HERE / "enhanced_on_ranks.py", ranks, 300))


@parallel.on_1_to_3_ranks
def test_ranks_agree(ranks):
    """Histories with a body, pressure, viscosity and ξ."""
    found, alone = _histories(ranks), _histories(1)
    scale = np.abs(alone).max(axis=0)
    np.testing.assert_allclose(found / scale, alone / scale, atol=1e-10)


def test_bodies_wake_beside_enhanced_cells():
    """Parts are found and woken by their shadows, whose stiffness and viscosity are enhanced."""
    domain = rf.box((0, 0, 0), (8, 1, 0.5), (8, 1, 1), comm=MPI.COMM_SELF)
    push = rf.Traction("x1", (0, 0, 4.0), time=rf.Table((0, 1, 2, 8), (0, 1, 0, 0)))
    criterion = rf.StrainRate(tol=6e-3, window=0.5, wake="local", patience=1.0)
    scene = scene_of(domain, rf.Fixed("x0"), push, rf.KelvinVoigt(10.0))
    reports = list(rf.simulate(scene, 0.05, 6.0, rigidify=criterion))
    assert any(e.kind == "freeze" for r in reports for e in r.events)
    assert any(np.size(e.woken) for r in reports for e in r.events)
    assert imbalance(reports) < 1e-11


def test_strong_compression_is_warned_of():
    """A bar pushed together to 0.6 of its length, named cell and all; to 0.85, nothing is said."""
    for stretch in (0.85, 0.6):
        end = rf.PrescribedMotion(
            "x1",
            "x",
            displacement=lambda t, s=stretch: ((s - 1) * 2.0 * t, 0, 0),
            velocity=lambda t, s=stretch: ((s - 1) * 2.0, 0, 0),
        )
        domain = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1), comm=MPI.COMM_SELF)
        sides = [rf.Fixed("y0", "y"), rf.Fixed("y1", "y"), rf.Fixed("z0", "z"), rf.Fixed("z1", "z")]
        scene = scene_of(domain, rf.Fixed("x0"), end, *sides, rf.MassDamping(20.0))
        if stretch < 0.7:
            with pytest.warns(
                rf.RigidfxWarning, match=r"cell \d of the mesh .* is compressed to 0.7"
            ):
                list(rf.simulate(scene, 0.01, 1.0))
        else:
            list(rf.simulate(scene, 0.01, 1.0))


# Refusals ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "found"),
    [
        (
            {"element": "enhanced!"},
            "must be 'standard', 'enhanced' or AssumedStrains.*, got 'enhanced!'",
        ),
        ({"element": None}, "got None"),
        ({"order": 2}, "is for order 1, got order 2"),
        ({"material": rf.NeoHooke(E=1e4, nu=0.3, rho=1.0)}, "StVenantKirchhoff.*got NeoHooke"),
        ({"scheme": rf.Midpoint()}, "goes with EnergyMomentum, not with Midpoint"),
        ({"cell": "tetrahedron"}, "is for hexahedra"),
    ],
)
def test_what_cannot_be_is_refused(options, found):
    options = {"element": "enhanced", "cell": "hexahedron", "material": MATERIAL} | options
    domain = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1), options.pop("cell"))
    with pytest.raises(rf.SceneError, match=found):
        rf.Scene(domain, options.pop("material"), **options)


def test_an_element_costs_only_who_names_it():
    """Forms of standard cells have neither a coefficient nor a constant more."""
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), MATERIAL)
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0)
    form = forces.residual_form
    assert set(form.coefficients()) == {u0, forces.u1}
    assert len(form.constants()) == 2
    assert isinstance(form, ufl.Form)
    assert scene.mesh.topology.cell_type == dmesh.CellType.hexahedron


def test_kernels_end_with_their_forms():
    """A process has room for so many; those of scenes that are gone make way."""
    gc.collect()
    before = alive()
    scene = scene_of(distorted((1, 1, 1), (1.0, 1.0, 1.0)))
    forces = Forces(scene)
    assert alive() > before
    energy = forces.of.bind_energy(forces.cells)
    u0 = forces.u0
    del forces
    gc.collect()
    u0.x.array[:] = 0.1 * scene.space.tabulate_dof_coordinates().reshape(-1) ** 2
    assert fem.assemble_scalar(energy) > 0  # a bound form holds what it calls
    assert alive() > before
    del energy
    gc.collect()
    assert alive() <= before

"""What enhanced and assumed strains share: derivatives, patch test, rigid motions, balances.

Run as a script under mpirun, this file follows a scene of each on as many ranks.
"""

from functools import cache

import numpy as np
import parallel
import pytest
from dolfinx import fem
from elements import (
    ELEMENTS,
    EXACT,
    MATERIAL,
    PARTS,
    SOFT,
    SPIN,
    Forces,
    bent,
    distorted,
    scene_of,
)
from histories import changes, imbalance, show
from mpi4py import MPI
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.stress import CauchyStress
from rigidfx.scene.cells import thickness_axes

ANY = 1e9  # a tolerance under which everything is rigid
SIZES = {"enhanced": (0.05, 0.03), "assumed": (0.02, 0.01)}  # of displacements at random [m]

of_each = pytest.mark.parametrize("element", ELEMENTS)
of_materials = pytest.mark.parametrize("material", [MATERIAL, SOFT], ids=["quadratic", "neo-Hooke"])


# The cell ----------------------------------------------------------------------------------------


@of_materials
@of_each
def test_forces_and_tangents_are_derivatives(element, material):
    """Of the energy, and of the forces; for small strains all materials are one."""
    scene = scene_of(element, PARTS[element](), material=material)
    forces, rng = Forces(scene), np.random.default_rng(2)
    u, d = rng.normal(scale=SIZES[element][material is SOFT], size=(2, forces.u0.x.array.size))
    h = 1e-5 if element == "enhanced" else 1e-6
    f = forces.at(u)
    slope = (forces.energy(u + h * d) - forces.energy(u - h * d)) / (2 * h)
    assert f @ d == pytest.approx(slope, rel=1e-7)
    change = (forces.at(u + h * d) - forces.at(u - h * d)) / (2 * h)
    K = forces.tangent(u)
    np.testing.assert_allclose(K @ d, change, atol=1e-7 * np.abs(change).max())
    assert abs(K - K.T).max() < EXACT * abs(K).max()
    small, plain = 1e-7 * u, Forces(scene_of(element, PARTS[element]())).at(1e-7 * u)
    np.testing.assert_allclose(forces.at(small), plain, atol=1e-5 * np.abs(plain).max())


@pytest.mark.parametrize("damped", [False, True])
@of_materials
@of_each
def test_tangent_of_a_step_is_the_derivative_of_its_residual(element, material, damped):
    """With and without ξ and viscous stresses, whose modes are their own; some cells are thin."""
    effects = [rf.KelvinVoigt(30.0), rf.NumericalDamping(0.1)] if damped else []
    domain, h, near = PARTS[element](), 1e-5, 1e-8
    if element == "assumed":
        effects += [rf.StiffnessDamping(0.1, 1.0)] if damped else []
        domain = domain.with_facets(
            "some", lambda x: (np.hypot(x[0], x[2]) > 1.1 - 1e-9) & (x[0] < 0.7)
        )
        assert set(thickness_axes(domain, "some")) == {0, 3}
        scene = rf.Scene(domain, material, effects, element=rf.AssumedStrains("some"))
        h, near = 1e-6, 1e-7
    else:
        scene = scene_of(element, domain, *effects, material=material)
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0, acting=[effects])
    forces.set_time(0.0, 0.1)
    bound = forces.bind(forces.cells())
    rng = np.random.default_rng(1)
    x0, x1, d = rng.normal(scale=SIZES[element][material is SOFT], size=(3, u0.x.array.size))

    def residual(x):
        forces.u1.x.array[:] = x
        return fem.assemble_vector(bound.residual).array.copy()

    u0.x.array[:] = x0
    change = (residual(x1 + h * d) - residual(x1 - h * d)) / (2 * h)
    residual(x1)
    K = fem.assemble_matrix(bound.interior).to_scipy()
    np.testing.assert_allclose(K @ d, change, atol=near * np.abs(change).max())


def prisms():
    """A flat part of two layers, 0.1 m thick, whose cells have any quadrilateral as base."""
    n = 3
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2, indexing="ij"), axis=-1)
    grid[1:-1, 1:-1] += np.random.default_rng(5).uniform(-0.1, 0.1, (n - 1, n - 1, 2))
    points = np.concatenate([np.dstack([grid, np.full(grid.shape[:2], z)]).reshape(-1, 3)
                             for z in (0.0, 0.05, 0.1)])  # fmt: skip
    number = np.arange(len(points)).reshape(3, n + 1, n + 1)
    cells = np.stack([number[k : k + 2, i : i + n, j : j + n].reshape(-1)
                      for k in (0, 1) for j in (0, 1) for i in (0, 1)], axis=1)  # fmt: skip
    domain = rf.from_arrays(points, cells, comm=MPI.COMM_SELF)
    return domain.with_facets("outside", lambda x: x[2] > 0.1 - 1e-9)


# Assumed strains find constant ones in prisms only.
PATCHES = {
    "enhanced": (lambda: distorted((3, 3, 3), (1.0, 1.1, 0.9), 0.1), (1.0, 1.1, 0.9)),
    "assumed": (prisms, (1.0, 1.0, 0.1)),
}


@of_each
def test_patch(element):
    """Any constant strain is found inside, and its energy is exact."""
    make, size = PATCHES[element]
    scene = scene_of(element, make())
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    G = np.random.default_rng(4).normal(scale=1e-2, size=(3, 3))
    u = X @ G.T
    f = forces.at(u)
    outside = np.any((X < 1e-9) | (np.array(size) - 1e-9 < X), axis=1).repeat(3)
    assert np.abs(f[~outside]).max() < EXACT * np.abs(f).max()
    K = forces.tangent(0 * u)
    inner = np.flatnonzero(~outside)
    found = spsolve(K[inner][:, inner].tocsc(), -(K @ (u.reshape(-1) * outside))[inner])
    np.testing.assert_allclose(found, u.reshape(-1)[inner], atol=EXACT)
    E = (G + G.T + G.T @ G) / 2
    lam, mu = MATERIAL.parameters["lmbda"], MATERIAL.parameters["mu"]
    W = lam / 2 * np.trace(E) ** 2 + mu * np.vdot(E, E)
    assert forces.energy(u) == pytest.approx(W * np.prod(size), rel=EXACT)


@of_each
def test_rigid_motions_strain_nothing_and_nothing_else_is_free(element):
    """Six eigenvalues are zero; energy and forces turn with what turns."""
    scene = scene_of(element, PARTS[element]())
    forces = Forces(scene)
    X = scene.space.tabulate_dof_coordinates()
    values = np.linalg.eigvalsh(forces.tangent(0 * X).toarray())
    assert np.abs(values[:6]).max() < 1e-11 * values[-1]
    assert values[6] > 1e-7 * values[-1]
    R = Rotation.from_rotvec([0.7, -1.1, 2.0]).as_matrix()
    scale = np.abs(forces.at(0.01 * X)).max() / 0.01
    assert np.abs(forces.at(X @ R.T - X)).max() < 1e-13 * scale
    u = np.random.default_rng(5).normal(scale=SIZES[element][1], size=X.shape)
    turned = (X + u) @ R.T - X
    near = EXACT if element == "enhanced" else 1e-11
    assert forces.energy(turned) == pytest.approx(forces.energy(u), rel=near)
    np.testing.assert_allclose(
        forces.at(turned).reshape(-1, 3), forces.at(u).reshape(-1, 3) @ R.T, atol=EXACT * scale
    )


@of_each
def test_rank_of_a_cell(element):
    """One cell has six motions without energy."""
    one = {"enhanced": lambda: distorted((1, 1, 1)), "assumed": lambda: bent((1, 1, 1))}
    K = Forces(scene_of(element, one[element]())).tangent(np.zeros(24)).toarray()
    values = np.linalg.eigvalsh(K)
    assert np.abs(values[:6]).max() < EXACT * values[-1] < 1e-6 * values[6]


# Dynamics ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("element", "mass", "material"),
    [
        *((element, mass, MATERIAL) for element in ELEMENTS for mass in ("lumped", "consistent")),
        ("assumed", "lumped", SOFT),
    ],
)
def test_free_flight_and_a_cycle(element, mass, material):
    """H, L and J stay while it is frozen, turns by a radian, is released, twice, and then flies."""
    released = rf.Release(at=[1.0, 2.0])
    criterion = rf.StrainRate(ANY, 0.2, release=released, until=1.5, wake="none")
    scene = scene_of(element, PARTS[element](), SPIN, mass=mass, material=material)
    stress = CauchyStress(scene)
    reports, sizes = [], []
    for r in rf.simulate(
        scene, 0.02, {"enhanced": 5.6, "assumed": 2.4}[element], rigidify=criterion
    ):
        reports.append(r)
        if r.unknowns == 6:
            sizes.append(np.linalg.norm(stress.measure(r.state.u), axis=(1, 2)))
    found = dict(zip("HLJ", changes(reports), strict=True))
    show(**found, strain=max(r.strain for r in reports) / reports[0].energy)
    assert max(r.strain for r in reports) > 0.02 * reports[0].energy
    assert max(found.values()) < 1e-11
    assert sum(e.kind == "release" for r in reports for e in r.events) == 2
    # a turned body keeps the size of its stresses
    np.testing.assert_allclose(
        sizes[1], sizes[0], rtol={"enhanced": 1e-10, "assumed": 1e-9}[element]
    )
    assert sizes[0].min() > 0


@pytest.mark.parametrize(
    ("element", "pressure"), [("enhanced", None), ("enhanced", 30.0), ("assumed", 3.0)]
)
def test_damping_takes_what_it_says(element, pressure):
    """ξ and both viscosities, without and with a pressure; none of them ever gives energy."""
    damping = [rf.NumericalDamping(0.1), rf.KelvinVoigt(40.0), rf.StiffnessDamping(0.05, 2.0)]
    pressed = [] if pressure is None else [rf.Pressure("outside", pressure)]
    domain = bent()
    if element == "enhanced":
        domain = rf.box((0, 0, 0), (4, 1, 0.5), (5, 2, 1), comm=MPI.COMM_SELF)
        domain = domain.with_facets("outside", lambda x: x[2] > 0.5 - 1e-9)
    scene = scene_of(element, domain, SPIN, *damping, *pressed)
    reports = list(rf.simulate(scene, 0.02, 1.0))
    assert imbalance(reports) < 1e-12
    for effect in damping:
        lost = [r.dissipated[effect.kind] for r in reports[1:]]
        assert min(lost) > 0
        assert sum(lost) > 1e-3 * reports[0].energy


@of_each
def test_bodies_wake_beside_them(element):
    """Parts are found, get shapes of the same stiffness and viscosity, and wake."""
    domain = rf.box((0, 0, 0), (8, 1, 0.5), (8, 1, 1), comm=MPI.COMM_SELF)
    domain = domain.with_facets("outside", lambda x: x[2] > 0.5 - 1e-9)
    push = rf.Traction("x1", (0, 0, 4.0), time=rf.Table((0, 1, 2, 8), (0, 1, 0, 0)))
    criterion = rf.StrainRate(tol=1e-3, window=0.5, wake="local", patience=1.0)
    scene = scene_of(element, domain, rf.Fixed("x0"), push, rf.KelvinVoigt(10.0))
    reports = list(rf.simulate(scene, 0.05, 6.0, rigidify=criterion))
    assert any(e.kind == "freeze" for r in reports for e in r.events)
    assert any(e.woken.size for r in reports for e in r.events)
    assert imbalance(reports) < 1e-11


# Several ranks -----------------------------------------------------------------------------------


def followed(element, domain, pressure, mass, material=MATERIAL):
    """A history with every term of the forms, beside a body."""
    pressed = rf.Pressure("outside", pressure)
    effects = [SPIN, rf.Rigid("end"), pressed, rf.KelvinVoigt(20.0), rf.NumericalDamping(0.05)]
    scene = scene_of(element, domain, *effects, mass=mass, material=material)
    reports = list(rf.simulate(scene, 0.05, 0.5))
    assert imbalance(reports) < 1e-11, imbalance(reports)
    return [
        [r.kinetic, r.strain, *r.linear_momentum, *r.angular_momentum, sum(r.dissipated.values())]
        for r in reports
    ]


def thin_ways(comm):
    """Which way each cell is thin, through three layers, by the cells' numbers in the input."""
    domain = bent((6, 4, 3), comm, turned=1)
    owned = domain.mesh.topology.index_map(3).size_local
    numbers = domain.mesh.topology.original_cell_index[:owned]
    pairs = comm.allgather(np.c_[numbers, thickness_axes(domain, "outside")[:owned]])
    found = np.concatenate(pairs)
    return found[np.argsort(found[:, 0])].tolist()


def on_ranks(comm):
    """What ranks are to agree on."""
    long = rf.box((0, 0, 0), (6, 1, 1), (6, 2, 2), comm=comm)
    long = long.with_cells("end", lambda x: x[0] > 4 - 1e-9)
    long = long.with_facets("outside", lambda x: x[2] < 1e-9)
    tube = bent((6, 4, 1), comm, turned=2).with_cells("end", lambda x: x[1] > 1.0)
    rows = [followed("enhanced", long, 40.0, mass) for mass in ("lumped", "consistent")]
    return [thin_ways(comm), *rows, followed("assumed", tube, 3.0, "lumped", SOFT)]


@cache
def alone():
    return on_ranks(MPI.COMM_SELF)


@pytest.mark.parallel
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts its ranks itself")
def test_ranks_agree():
    """On which way cells are thin, and on histories with a body."""
    (ways, *several), (expected, *ones) = parallel.run(__file__, 3, 300), alone()
    np.testing.assert_array_equal(ways, expected)
    for found, one in zip(several, ones, strict=True):
        scale = np.abs(one).max(axis=0)
        np.testing.assert_allclose(found / scale, one / scale, atol=1e-10)


# Refusals ----------------------------------------------------------------------------------------


if __name__ == "__main__":
    parallel.report(on_ranks(MPI.COMM_WORLD))

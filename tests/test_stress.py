"""Cauchy stress of cells: closed forms, equilibrium, and what frozen parts keep."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial.transform import Rotation

import rigidfx as rf
from rigidfx.flexible.stress import CauchyStress, von_mises

SVK = rf.StVenantKirchhoff(E=2e5, nu=0.3, rho=1000.0)
NEO_HOOKE = rf.NeoHooke(E=1e5, nu=0.4, rho=900.0)
MOONEY = rf.MooneyRivlin(c10=2e4, c01=1e4, kappa=3e5, rho=950.0)
EPS = np.finfo(np.float64).eps


def closed_form(material, F):
    """σ of each material by its textbook formula."""
    J, B, identity = np.linalg.det(F), F @ F.T, np.eye(3)
    p = material.parameters
    if material is SVK:
        E = (F.T @ F - identity) / 2
        S = p["lmbda"] * np.trace(E) * identity + 2 * p["mu"] * E
        return F @ S @ F.T / J
    if material is NEO_HOOKE:
        return (p["mu"] * (B - identity) + p["lmbda"] * np.log(J) * identity) / J
    b = B / J ** (2 / 3)
    s = 2 / J * ((p["c10"] + p["c01"] * np.trace(b)) * b - p["c01"] * b @ b)
    return s - np.trace(s) / 3 * identity + p["kappa"] * (J - 1) * identity


def deformed(scene, F):
    """The displacement of x = F X."""
    u = fem.Function(scene.space)
    u.interpolate(lambda x: (F - np.eye(3)) @ x)
    return u


TURN = Rotation.from_rotvec([0.7, -1.1, 0.9]).as_matrix()
STRETCHES = {
    "uniaxial": np.diag([1.2, 1.0, 1.0]),
    "turned": TURN @ np.diag([1.15, 0.95, 0.9]),
    "sheared": TURN @ (np.eye(3) + 0.2 * np.outer([1.0, 0, 0], [0, 0, 1.0])),
}


@pytest.mark.parametrize("F", STRETCHES.values(), ids=STRETCHES)
@pytest.mark.parametrize("material", [SVK, NEO_HOOKE, MOONEY], ids=["svk", "neo", "mooney"])
def test_homogeneous_deformation(material, F):
    """Exact in every cell, after any rotation."""
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 2, 1)), material)
    stress = CauchyStress(scene).measure(deformed(scene, F))
    expected = closed_form(material, F)
    scale = sum(abs(x) for x in material.parameters.values())
    np.testing.assert_allclose(
        stress, np.broadcast_to(expected, stress.shape), atol=1e3 * EPS * scale
    )
    assert np.abs(expected).max() > 1e-2 * scale


@pytest.mark.parametrize(("cell", "order"), [("tetrahedron", 1), ("hexahedron", 2)])
def test_several_materials(cell, order):
    """Cells find their own parameters, and their own energy."""
    domain = rf.box((0, 0, 0), (3, 1, 1), (3, 1, 1), cell)
    parts = {"a": (0, 1), "b": (1, 2), "c": (2, 3)}
    for name, (low, high) in parts.items():
        domain = domain.with_cells(
            name, lambda x, low=low, high=high: (x[0] > low - 0.01) & (x[0] < high + 0.01)
        )
    stiff = rf.StVenantKirchhoff(E=4e5, nu=0.2, rho=1.0)
    scene = rf.Scene(domain, {"a": SVK, "b": NEO_HOOKE, "c": stiff}, order=order)
    F = STRETCHES["turned"]
    stress = CauchyStress(scene).measure(deformed(scene, F))
    E = (F.T @ F - np.eye(3)) / 2
    S = stiff.parameters["lmbda"] * np.trace(E) * np.eye(3) + 2 * stiff.parameters["mu"] * E
    third = F @ S @ F.T / np.linalg.det(F)
    values = (closed_form(SVK, F), closed_form(NEO_HOOKE, F), third)
    for (_, cells), expected in zip(scene.materials, values, strict=True):
        given = stress[cells]
        np.testing.assert_allclose(given, np.broadcast_to(expected, given.shape), atol=1e-7)


def test_mean_stress_is_what_nodal_forces_say():
    """Σ v σ = Σ x ⊗ f for any displacement, f the derivative of the stored energy."""
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (4, 2, 2)), NEO_HOOKE)
    u = fem.Function(scene.space)
    u.interpolate(lambda x: 0.1 * np.array([x[1] ** 2, x[0] * x[2], np.sin(x[0])]))
    F = ufl.Identity(3) + ufl.grad(u)
    dx = ufl.dx(metadata={"quadrature_degree": scene.quadrature_degree})
    p = NEO_HOOKE.parameters
    energy = NEO_HOOKE.energy(F.T * F, **p) * dx
    f = fem.Function(scene.space)
    fem.assemble_vector(f.x.array, fem.form(ufl.derivative(energy, u)))
    n = scene.owned_nodes
    from dolfinx import la

    f.x.scatter_reverse(la.InsertMode.add)
    x = scene.space.tabulate_dof_coordinates()[:n] + u.x.array.reshape(-1, 3)[:n]
    virial = scene.sum(x.T @ f.x.array.reshape(-1, 3)[:n])
    volumes = fem.Function(fem.functionspace(scene.mesh, ("DG", 0)))
    test = ufl.TestFunction(volumes.function_space)
    fem.assemble_vector(volumes.x.array, fem.form(ufl.det(F) * test * dx))
    stress = CauchyStress(scene).measure(u)
    cells = volumes.function_space.dofmap.list[: len(stress), 0]
    total = scene.sum(np.einsum("c,cij->ij", volumes.x.array[cells], stress))
    np.testing.assert_allclose(total, virial, atol=1e-12 * p["mu"])
    assert np.abs(virial).max() > 1e-2 * p["mu"]


def test_von_mises():
    tension, pressure, shear = np.zeros((3, 3, 3))
    tension[1, 1] = -7.0
    pressure[:] = 5.0 * np.eye(3)
    shear[0, 2] = shear[2, 0] = 2.0
    both = TURN @ (tension + pressure) @ TURN.T
    values = von_mises(np.array([tension, pressure, shear, both]))
    np.testing.assert_allclose(values, [7.0, 0.0, 2 * np.sqrt(3), 7.0], atol=1e-13)


def test_frozen_parts_keep_their_stress_and_turn_it():
    """To rounding, through a turn of more than a radian."""
    domain = rf.box((0, 0, 0), (6, 1, 1), (6, 1, 1))
    domain = domain.with_cells("middle", lambda x: np.abs(x[0] - 3) < 1 + 1e-9)
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    scene = rf.Scene(domain, material, [rf.InitialVelocity(angular=(0.4, 0.3, 1.5))])
    measure = CauchyStress(scene)
    criterion = rf.StrainRate(1e9, 0.5, never="middle", wake="none")
    frozen, turned = {}, 0.0
    for report in rf.simulate(scene, 0.05, 1.8, rigidify=criterion, progress=False):
        state = report.state
        state.rebuild()
        stress = measure.measure(state.u)
        if report.events:
            frozen = {b.number: stress[b.cells] for b in state.bodies.of.records}
        for each in state.bodies:
            body, motion = each.data, each.motion
            now, then = stress[body.cells], frozen[body.number]
            scale = np.abs(then).max(initial=1e-300)
            expected = motion.R @ then @ motion.R.T
            # Displacements, not strains, carry rounding errors: stresses have them times E.
            np.testing.assert_allclose(now, expected, atol=100 * EPS * 1e4)
            np.testing.assert_allclose(von_mises(now), von_mises(then), atol=100 * EPS * 1e4)
            assert scale > 10.0 or then.size == 0
            turned = max(turned, Rotation.from_matrix(motion.R).magnitude())
    assert len(frozen) == 2
    assert turned > 1.0


def test_nothing_is_compiled_unless_asked_for(tmp_path, monkeypatch):
    def fail(*_):
        raise AssertionError("a form of stresses is compiled")

    monkeypatch.setattr("rigidfx.flexible.stress.compile_expression", fail)
    scene = rf.Scene(rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1)), SVK)
    folder = MPI.COMM_WORLD.bcast(str(tmp_path))
    with rf.Recorder(scene, folder, stress=False) as recorder:
        for report in rf.simulate(scene, 0.1, 0.1, progress=False):
            recorder.write(report)
    with pytest.raises(AssertionError, match="compiled"):
        rf.Recorder(scene, folder)

"""Cauchy stress of cells: closed forms, equilibrium, and what frozen parts keep."""

import numpy as np
import pytest
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


def test_von_mises():
    tension, pressure, shear = np.zeros((3, 3, 3))
    tension[1, 1] = -7.0
    pressure[:] = 5.0 * np.eye(3)
    shear[0, 2] = shear[2, 0] = 2.0
    both = TURN @ (tension + pressure) @ TURN.T
    values = von_mises(np.array([tension, pressure, shear, both]))
    np.testing.assert_allclose(values, [7.0, 0.0, 2 * np.sqrt(3), 7.0], atol=1e-13)


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

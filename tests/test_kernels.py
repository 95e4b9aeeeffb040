"""A bound form reads the coefficients it was written with."""

from __future__ import annotations

import basix
import numpy as np
import pytest
from dolfinx import fem

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces


@pytest.mark.parametrize("scheme", [rf.EnergyMomentum(), rf.Midpoint(), rf.Trapezoidal()])
def test_tangent_is_the_derivative_of_the_residual(scheme):
    """The trapezoidal rule's tangent has lost u₀: it must not read u₀ where it means u₁."""
    material = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
    scene = rf.Scene(rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), material, scheme=scheme)
    u0 = fem.Function(scene.space)
    forces = InternalForces(scene, u0)
    bound = forces.bind(forces.cells())
    rng = np.random.default_rng(1)
    x0, x1, direction = rng.normal(scale=0.1, size=(3, u0.x.array.size))

    def residual(x):
        forces.u1.x.array[:] = x
        return fem.assemble_vector(bound.residual).array.copy()

    u0.x.array[:] = x0
    h = 1e-5
    quotient = (residual(x1 + h * direction) - residual(x1 - h * direction)) / (2 * h)
    residual(x1)
    K = fem.assemble_matrix(bound.interior).to_scipy()
    # The residual is cubic in u₁: the error of the quotient is of the order h².
    np.testing.assert_allclose(K @ direction, quotient, atol=1e-8 * np.abs(quotient).max())


@pytest.mark.parametrize("material", [rf.StVenantKirchhoff, rf.NeoHooke])
def test_one_point_does_for_tetrahedra_of_first_order(monkeypatch, material):
    """Their strain is constant: four points took four times the work for the same numbers."""
    domain = rf.box((0, 0, 0), (2, 1, 1), (3, 2, 2), "tetrahedron")
    effects = [
        rf.NumericalDamping(0.1),
        rf.KelvinVoigt(0.3),
        rf.Pressure("x1", 0.2),
    ]
    found = []
    for degree in (None, 2):
        if degree is not None:
            monkeypatch.setattr(rf.Scene, "quadrature_degree", degree)
        scene = rf.Scene(domain, material(rho=1.0, E=10.0, nu=0.3), effects)
        points, _ = basix.make_quadrature(basix.CellType.tetrahedron, scene.quadrature_degree)
        assert len(points) == (1 if degree is None else 4)
        forces = InternalForces(scene, fem.Function(scene.space))
        forces.set_time(0.1, 0.2)
        rng = np.random.default_rng(3)
        for u in (forces.u0, forces.u1):
            u.x.array[:] = 0.05 * rng.uniform(-1, 1, u.x.array.size)
        bound = forces.bind(forces.cells())
        residual = fem.assemble_vector(bound.residual).array
        tangent = fem.assemble_matrix(bound.interior).to_dense()
        energy = fem.assemble_scalar(forces.bind_energy(forces.cells()))
        lost = [fem.assemble_scalar(f) for f in forces.bind_dissipation(forces.cells()).values()]
        found.append((residual, tangent, np.array([energy, *lost])))
    for one, four in zip(*found, strict=True):
        assert np.abs(one - four).max() <= 1e-14 * np.abs(four).max()

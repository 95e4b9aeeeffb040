"""Assumed strains of thin cells: a second program, shells, thickness; see also test_elements.py."""

from __future__ import annotations

import numpy as np
import pytest
from elements import Forces
from histories import show
from mpi4py import MPI
from scipy.sparse.linalg import spsolve

import rigidfx as rf
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.scene.cells import thickness_axes

# The cell ----------------------------------------------------------------------------------------


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


# Thickness ---------------------------------------------------------------------------------------


def test_the_thickness_goes_on_through_layers():
    """From one side of three layers to the other, and no farther than the named part."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 3), comm=MPI.COMM_SELF)
    domain = domain.with_facets("half", lambda x: (x[2] > 1 - 1e-9) & (x[0] < 2 + 1e-9))
    middles = domain.mesh.geometry.x[cell_geometry_dofs(domain.mesh)].mean(axis=1)
    np.testing.assert_array_equal(thickness_axes(domain, "half"), np.where(middles[:, 0] < 2, 3, 0))

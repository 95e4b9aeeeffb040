"""Hertz's contact of a rigid sphere and a block."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import rigidfx as rf


def hertz(short: bool) -> dict[str, float]:
    """A rigid sphere slowly pressed into a quarter of a block: force and approach."""
    R, nu, E, depth, rho = 1.0, 0.3, 1e6, 4e-4, 1000.0
    a = float(np.sqrt(R * depth))
    n, growth, first = (12, 1.45, a / 4) if short else (16, 1.33, a / 7)
    lines = np.r_[0.0, np.cumsum(first * growth ** np.arange(n))]
    domain = graded(lines)
    fall, calm = 0.2, 0.1  # s, slow against L/c = 0.03 s
    ball = rf.Sphere((0, 0, R), R, path=lambda t: (0, 0, -depth * min(t / fall, 1.0)))
    contact = rf.Contact("top", against=ball, title="ball")
    held = [rf.Fixed("x0", "x"), rf.Fixed("y0", "y"), rf.Fixed("bottom")]
    effects = [contact, *held, rf.MassDamping(200.0)]
    scene = rf.Scene(domain, rf.StVenantKirchhoff(E=E, nu=nu, rho=rho), effects)
    *_, last = rf.simulate(scene, 0.01, fall + calm)
    known = 4 / 3 * E / (1 - nu**2) * np.sqrt(R) * depth**1.5
    force = -4 * last.touches["ball"].force[2]
    return {"force_error": abs(force / known - 1), "penetration_by_approach":
            last.touches["ball"].penetration / depth}  # fmt: skip


def graded(lines: np.ndarray) -> rf.Domain:
    """A quarter of a block below z = 0; cells grow away from the origin."""
    n = lines.size
    x, y, z = np.meshgrid(lines, lines, -lines[::-1], indexing="ij")
    points = np.stack([x.reshape(-1), y.reshape(-1), z.reshape(-1)], axis=1)
    i, j, k = np.meshgrid(*[np.arange(n - 1)] * 3, indexing="ij")
    corner = (i * n * n + j * n + k).reshape(-1)
    offsets = [a * n * n + b * n + c for c in (0, 1) for b in (0, 1) for a in (0, 1)]
    cells = corner[:, None] + np.array(offsets)
    if MPI.COMM_WORLD.rank:
        points, cells = points[:0], cells[:0]
    domain, far = rf.from_arrays(points, cells), -lines[-1]
    faces = {
        "top": lambda x: np.isclose(x[2], 0.0),
        "bottom": lambda x: np.isclose(x[2], far),
        "x0": lambda x: np.isclose(x[0], 0.0),
        "y0": lambda x: np.isclose(x[1], 0.0),
    }
    for name, marker in faces.items():
        domain = domain.with_facets(name, marker)
    return domain

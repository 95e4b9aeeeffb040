"""What tests of elements share: parts of odd cells, their static forces, and balances of runs.

Of each element there is one part whose cells are no boxes: inside a box for enhanced strains, of a
tube, thin across, for assumed ones.
"""

import numpy as np
from dolfinx import fem
from mpi4py import MPI

import rigidfx as rf
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.linear_forms import static_forces

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.3, rho=10.0)
SOFT = rf.NeoHooke(E=1e4, nu=0.3, rho=10.0)
EXACT = 1e-12
ELEMENTS = {"enhanced": "enhanced", "assumed": rf.AssumedStrains("outside")}


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


PARTS = {"enhanced": distorted, "assumed": bent}


def scene_of(element, domain, *effects, material=MATERIAL, **options):
    """A scene with the element of that name."""
    return rf.Scene(domain, material, effects, element=ELEMENTS[element], **options)


class Forces:
    """Static forces and tangent of a scene at displacements, shape (nodes, 3)."""

    def __init__(self, scene):
        self.scene = scene
        self.u0 = fem.Function(scene.space)
        self.of = InternalForces(scene, self.u0)
        self.cells = self.of.cells()
        self.static = static_forces(self.scene, self.of, self.cells)

    def at(self, u):
        self.of.u1.x.array[:] = u.reshape(-1)
        return fem.assemble_vector(self.static.residual).array.copy()

    def tangent(self, u):
        self.of.u1.x.array[:] = u.reshape(-1)
        return fem.assemble_matrix(self.static.interior).to_scipy().tocsr()

    def energy(self, u):
        self.u0.x.array[:] = u.reshape(-1)
        return fem.assemble_scalar(self.of.bind_energy(self.cells))

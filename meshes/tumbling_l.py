"""The L-shaped body of Simo and Tarnow (1992), cut into equal cells.

[0,6]×[0,3]×[0,3] and [0,3]×[3,10]×[0,3] m: 117 unit hexahedra, 224 nodes. Its end faces are named
"top" (y = 10) and "side" (x = 6).
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
from mpi4py import MPI

from rigidfx import Domain, from_arrays

# The six tetrahedra of a cube: from corner 0 to corner 7 by one step along each axis, in any order.
TETRAHEDRA = [[0, 1 << a, (1 << a) + (1 << b), 7] for a, b, _ in permutations(range(3))]


def tumbling_l(
    refine: int = 1, cell: str = "hexahedron", comm: MPI.Comm = MPI.COMM_WORLD
) -> Domain:
    """The body with cells of edge 1/refine.

    Args:
        refine: Cells per metre.
        cell: "hexahedron" or "tetrahedron" (six to a cube).
        comm: Communicator of the mesh.
    """
    cells, points = _cubes(refine) if comm.rank == 0 else (np.empty((0, 8), int), np.empty((0, 3)))
    if cell == "tetrahedron":
        cells = cells[:, TETRAHEDRA].reshape(-1, 4)
    return (
        from_arrays(points, cells, cell, comm)
        .with_facets("top", lambda x: np.isclose(x[1], 10.0))
        .with_facets("side", lambda x: np.isclose(x[0], 6.0))
    )


def _cubes(refine: int) -> tuple[np.ndarray, np.ndarray]:
    """Corner numbers of the cubes, shape (cells, 8), and corner positions, shape (corners, 3)."""
    nx, ny, nz = 6 * refine, 10 * refine, 3 * refine
    i, j, k = (a.reshape(-1) for a in np.mgrid[:nx, :ny, :nz])
    inside = (j < 3 * refine) | (i < 3 * refine)
    i, j, k = i[inside], j[inside], k[inside]
    corner = np.stack(
        [((i + c % 2) * (ny + 1) + j + c // 2 % 2) * (nz + 1) + k + c // 4 for c in range(8)],
        axis=1,
    )
    used, cells = np.unique(corner, return_inverse=True)
    x, rest = np.divmod(used, (ny + 1) * (nz + 1))
    y, z = np.divmod(rest, nz + 1)
    return cells.reshape(corner.shape), np.stack([x, y, z], axis=1) / refine

"""Block with a cantilever: the free-flying body of Göttlicher & Schweizerhof (2005), section 7.1.

The paper's figure with the dimensions is not in its text. Chosen here, so that what the text gives
holds (574 nodes of 8-node bricks, 20 loaded nodes on the cantilever's top next to its free end) and
the turn about y is a stable one: cubes of 1 m, a block of 6 × 5 × 6 and, in the middle of its face,
a cantilever of 14 × 3 × 4.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx import Domain, from_arrays

BLOCK, CANTILEVER = (6, 5, 6), (14, 3, 4)  # cells along x, y, z
LOADED_ROWS = 5  # of four nodes each


def block_with_cantilever(comm: MPI.Comm = MPI.COMM_WORLD) -> Domain:
    """The body: 348 cells named "block" and "cantilever", and the vertices that are loaded.

    These are named "block top and bottom" and "tip".

    Args:
        comm: Communicator of the mesh.
    """
    cells, points = _cubes() if comm.rank == 0 else (np.empty((0, 8), int), np.empty((0, 3)))
    root, end = BLOCK[0], BLOCK[0] + CANTILEVER[0]
    top = (BLOCK[2] + CANTILEVER[2]) / 2
    return (
        from_arrays(points, cells, comm=comm)
        .with_cells("block", lambda x: x[0] <= root + 1e-9)
        .with_cells("cantilever", lambda x: x[0] >= root - 1e-9)
        .with_vertices(
            "block top and bottom",
            lambda x: (x[0] <= root + 1e-9) & (np.abs(x[2] - BLOCK[2] / 2) > BLOCK[2] / 2 - 1e-9),
        )
        .with_vertices("tip", lambda x: (x[0] > end - LOADED_ROWS + 0.5) & (x[2] > top - 1e-9))
    )


def _cubes() -> tuple[np.ndarray, np.ndarray]:
    """Corner numbers of the cubes, shape (cells, 8), and corner positions, shape (corners, 3)."""
    middle = [(b - c) // 2 for b, c in zip(BLOCK, CANTILEVER, strict=True)]
    starts = (0, 0, 0), (BLOCK[0], *middle[1:])
    lowest = np.concatenate(
        [
            np.indices(counts).reshape(3, -1).T + start
            for start, counts in zip(starts, (BLOCK, CANTILEVER), strict=True)
        ]
    )
    corners = np.indices((2, 2, 2)).reshape(3, -1).T[:, ::-1]  # x runs fastest
    every = (lowest[:, None, :] + corners).reshape(-1, 3)
    points, cells = np.unique(every, axis=0, return_inverse=True)
    return cells.reshape(-1, 8), points.astype(float)

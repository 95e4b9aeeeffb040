"""Block with a cantilever: the free-flying body of Göttlicher & Schweizerhof (2005), section 7.1.

The paper's figure with the dimensions is not in its text. Chosen here, so that what the text gives
holds (574 nodes of 8-node bricks, 20 loaded nodes on the cantilever's top next to its free end) and
the turn about y is a stable one: a block of 9 × 5.4 × 6 m in bricks of 1.5 × 0.6 × 1 m and, in the
middle of its face, a cantilever of 14 × 1.8 × 2 m in bricks of 2 × 0.6 × 1 m.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from rigidfx import Domain, from_arrays

BLOCK, CANTILEVER = (6, 9, 6), (7, 3, 2)  # cells along x, y, z
LENGTHS = 1.5, 2.0  # m; of a cell of the block and of the cantilever along x
WIDTH = 0.6  # m; of all cells along y; they are 1 m high
LOADED_ROWS = 5  # of four nodes each


def block_with_cantilever(refine: int = 1, comm: MPI.Comm = MPI.COMM_WORLD) -> Domain:
    """The body: 366 cells named "block" and "cantilever", and the vertices that are loaded.

    These are named "block top and bottom" and "tip". A finer mesh has more of them.

    Args:
        refine: How many cells an edge of each brick is divided into.
        comm: Communicator of the mesh.
    """
    cells, points = _bricks(refine) if comm.rank == 0 else (np.empty((0, 8), int), np.empty((0, 3)))
    root, height = LENGTHS[0] * BLOCK[0], BLOCK[2]
    top = (BLOCK[2] + CANTILEVER[2]) / 2
    loaded = root + LENGTHS[1] * (CANTILEVER[0] - LOADED_ROWS + 0.5)
    return (
        from_arrays(points, cells, comm=comm)
        .with_cells("block", lambda x: x[0] <= root + 1e-9)
        .with_cells("cantilever", lambda x: x[0] >= root - 1e-9)
        .with_vertices(
            "block top and bottom",
            lambda x: (x[0] <= root + 1e-9) & (np.abs(x[2] - height / 2) > height / 2 - 1e-9),
        )
        .with_vertices("tip", lambda x: (x[0] > loaded) & (x[2] > top - 1e-9))
    )


def _bricks(refine: int) -> tuple[np.ndarray, np.ndarray]:
    """Corner numbers of the bricks, shape (cells, 8), and corner positions, shape (corners, 3)."""
    middle = [(b - c) // 2 for b, c in zip(BLOCK, CANTILEVER, strict=True)]
    starts = (0, 0, 0), (BLOCK[0], *middle[1:])
    lowest = np.concatenate(
        [
            np.indices([refine * n for n in counts]).reshape(3, -1).T + refine * np.array(start)
            for start, counts in zip(starts, (BLOCK, CANTILEVER), strict=True)
        ]
    )
    corners = np.indices((2, 2, 2)).reshape(3, -1).T[:, ::-1]  # x runs fastest
    every = (lowest[:, None, :] + corners).reshape(-1, 3)
    numbers, cells = np.unique(every, axis=0, return_inverse=True)
    grid = numbers / refine
    x = LENGTHS[0] * np.minimum(grid[:, 0], BLOCK[0])
    x += LENGTHS[1] * np.maximum(grid[:, 0] - BLOCK[0], 0)
    points = np.column_stack([x, WIDTH * grid[:, 1], grid[:, 2]])
    return cells.reshape(-1, 8), points

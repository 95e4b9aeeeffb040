"""Block with a cantilever: the free-flying body of Göttlicher & Schweizerhof (2005), section 7.1.

The paper's figure with the dimensions is not in its text; what the text gives is kept: 574 nodes of
8-node bricks, 20 nodes on the top side of the cantilever next to its free end. All cells are cubes
of 1 m: a block of 12 × 6 × 3 and, flush with its top, a cantilever of 14 × 4 × 2.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import rigidfx

__all__ = ["block_with_cantilever"]

BLOCK, CANTILEVER = (12, 6, 3), (14, 4, 2)  # cells
LOADED_ROWS = 4  # of nodes at the free end, five in each


def block_with_cantilever(comm: MPI.Intracomm = MPI.COMM_WORLD) -> rigidfx.Domain:
    """The domain. Collective.

    Cells are named "block" and "cantilever"; vertices "block top and bottom" and "tip top".

    Args:
        comm: Communicator of the mesh.
    """
    lower = [(0, 0, 0), (BLOCK[0], 1, BLOCK[2] - CANTILEVER[2])]
    cells = np.concatenate(
        [np.indices(n).reshape(3, -1).T + at for at, n in zip(lower, (BLOCK, CANTILEVER), strict=True)]
    )
    corners = np.indices((2, 2, 2)).reshape(3, -1).T[:, ::-1]  # x fastest
    nodes = (cells[:, None, :] + corners).reshape(-1, 3)
    points, numbers = np.unique(nodes, axis=0, return_inverse=True)
    if comm.rank != 0:
        points, numbers = points[:0], numbers[:0]
    domain = rigidfx.from_arrays(points, numbers.reshape(-1, 8), comm=comm)
    end, top = BLOCK[0] + CANTILEVER[0], BLOCK[2]

    def level(x: np.ndarray, z: float) -> np.ndarray:
        return np.abs(x[2] - z) < 1e-9

    return (
        domain.with_cells("block", lambda x: x[0] < BLOCK[0] + 1e-9)
        .with_cells("cantilever", lambda x: x[0] > BLOCK[0] - 1e-9)
        .with_vertices(
            "block top and bottom",
            lambda x: (x[0] < BLOCK[0] + 1e-9) & (level(x, 0) | level(x, top)),
        )
        .with_vertices("tip top", lambda x: (x[0] > end - LOADED_ROWS + 0.5) & level(x, top))
    )

"""Blocks of hexahedra whose corners are anywhere, with named sides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.spatial import cKDTree

import rigidfx as rf

Array = npt.NDArray[np.float64]

CLOSE = 1e-9  # m


def block_of(n: tuple[int, int, int], place: Callable[[Array], Array]) -> rf.Domain:
    """A unit cube of n cells that is brought into another shape.

    Args:
        n: Cells along each axis.
        place: Function of places in the cube, shape (3, points), to those of the block [m].

    Returns:
        The domain; its sides are x0, x1, y0, … as those of the cube.
    """
    axes = [np.linspace(0, 1, k + 1) for k in n]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    cube = np.stack([x.reshape(-1), y.reshape(-1), z.reshape(-1)])
    points = place(cube).T
    number = np.arange(len(points)).reshape(x.shape)
    corners = [
        number[k : k + n[2], j : j + n[1], i : i + n[0]].reshape(-1)
        for k in (0, 1)
        for j in (0, 1)
        for i in (0, 1)
    ]
    cells = np.stack(corners, axis=1)
    first = MPI.COMM_WORLD.rank == 0
    domain = rf.from_arrays(points if first else points[:0], cells if first else cells[:0])
    for axis, name in enumerate("xyz"):
        for side in (0, 1):
            tree = cKDTree(points[cube[axis] == side])
            domain = domain.with_facets(
                f"{name}{side}", lambda X, tree=tree: tree.query(X.T)[0] < CLOSE
            )
    return domain

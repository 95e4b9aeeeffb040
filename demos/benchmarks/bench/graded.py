"""Blocks of hexahedra whose corners are anywhere, with named sides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from common import hexahedra, on_first_rank
from scipy.spatial import cKDTree

import rigidfx as rf

Array = npt.NDArray[np.float64]

CLOSE = 1e-9  # m


def block_of(n: tuple[int, int, int], place: Callable[[Array], Array]) -> rf.Domain:
    """A unit cube of n cells that a function of places, shape (3, points), brings into another one.

    Sides of the domain are x0, x1, y0, … as those of the cube.
    """
    cube, cells = hexahedra(*(np.linspace(0, 1, k + 1) for k in n))
    points = place(cube.T).T
    domain = on_first_rank(points, cells)
    for axis, name in enumerate("xyz"):
        for side in (0, 1):
            tree = cKDTree(points[cube[:, axis] == side])
            domain = domain.with_facets(
                f"{name}{side}", lambda X, tree=tree: tree.query(X.T)[0] < CLOSE
            )
    return domain

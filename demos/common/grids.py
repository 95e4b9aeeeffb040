"""Meshes of hexahedra, by arrays that are alike on any ranks."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

import rigidfx as rf

from .start import comm

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
CLOSE = 1e-9  # m


def on_first_rank(points: Array, cells: Ints, cell: str = "hexahedron") -> rf.Domain:
    """A domain of all points and cells, which the first rank hands in. Collective."""
    mine = slice(0 if comm.rank else None)
    return rf.from_arrays(points[mine], cells[mine], cell)


def hexahedra(*lines: npt.ArrayLike) -> tuple[Array, Ints]:
    """Points, x slowest and z fastest, and cells of a grid of lines along x, y and z."""
    points = np.stack(np.meshgrid(*map(np.asarray, lines), indexing="ij"), axis=-1).astype(float)
    number = np.arange(points[..., 0].size).reshape(points.shape[:3])
    nx, ny, nz = np.subtract(number.shape, 1)
    corners = [
        number[i : i + nx, j : j + ny, k : k + nz].reshape(-1)
        for k in (0, 1)
        for j in (0, 1)
        for i in (0, 1)
    ]
    return points.reshape(-1, 3), np.stack(corners, axis=1)


def ring(n: int, inner: float, outer: float, width: float, turned: float = 0.0) -> rf.Domain:
    """A closed ring of n cells about the z axis, from an angle on [rad]. Collective.

    x of a cell runs outwards, y along the ring, z up.
    """
    angle = 2 * np.pi * np.arange(n) / n + turned
    sections = [np.c_[r * np.cos(angle), r * np.sin(angle), np.full(n, z)]
                for z in (0.0, width) for r in (inner, outer)]  # fmt: skip
    k, after = np.arange(n), (np.arange(n) + 1) % n
    square = np.stack([k, k + n, after, after + n], axis=1)
    return on_first_rank(np.concatenate(sections), np.concatenate([square, square + 2 * n], axis=1))


def arrays(*ends: Any) -> tuple[Array, Ints]:
    """Points and cells of boxes that share no node, each from corner to corner in so many cells."""
    every, first = [], 0
    for low, high, count in ends:
        lines = [np.linspace(*line) for line in zip(low, high, np.add(count, 1), strict=True)]
        points, cells = hexahedra(*lines)
        every.append((points, cells + first))
        first += len(points)
    points, cells = (np.concatenate(part) for part in zip(*every, strict=True))
    return points, cells


def boxes(*ends: Any, hollow: tuple[Array, Array] | None = None) -> rf.Domain:
    """A domain of boxes, as in `arrays`. Collective.

    The first of them has no cells within `hollow`, if there is one.
    """
    points, cells = arrays(*ends)
    if hollow is not None:
        middles = points[cells].mean(axis=1)
        inside = ((middles > hollow[0]) & (middles < hollow[1])).all(axis=1)
        inside[np.prod(ends[0][2]) :] = False
        cells = cells[~inside]
    used, cells = np.unique(cells.reshape(-1), return_inverse=True)
    return on_first_rank(points[used], cells.reshape(-1, 8))


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

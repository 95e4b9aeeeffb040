"""Domains without a file: boxes of equal cells, and cells given as arrays."""

from __future__ import annotations

import hashlib
import operator
from collections.abc import Sequence
from math import prod

import basix.ufl
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI

from rigidfx.base import compat
from rigidfx.base.errors import SceneError, agree
from rigidfx.base.inputs import communicator, numbers, shown
from rigidfx.base.taken import check_same
from rigidfx.base.types import Ints
from rigidfx.domain.cell_quality import (
    CORNERS,
    advice_on,
    collapsed,
    degree_of,
    in_dolfinx_order,
    widths,
)
from rigidfx.domain.domain import CELLS, Domain, Marker

MOST = 2**31 - 1  # cells of a box


def box(
    lower: Sequence[float],
    upper: Sequence[float],
    cells: Sequence[int],
    cell: str = "hexahedron",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Domain:
    """A box of equal cells whose six faces are named x0, x1, y0, y1, z0, z1. Collective.

    Args:
        lower: Corner with the least coordinates [m].
        upper: Opposite corner [m].
        cells: Number of cells (of cubes, for tetrahedra) in each direction.
        cell: "hexahedron" or "tetrahedron".
        comm: Communicator of the mesh.

    Raises:
        SceneError: If the box has no volume, a number of cells is below one, the cell is unknown,
            or something is not the same on all ranks.
    """
    communicator("box", comm)
    check_same(comm, "box", {"lower": lower, "upper": upper, "cells": cells, "cell": cell})
    try:
        a, b = (numbers(corner) for corner in (lower, upper))
        given = list(cells)
        truth = any(isinstance(n, (bool, np.bool_)) for n in given)
        counts = [] if truth else [operator.index(n) for n in given]
    except (TypeError, ValueError):
        raise SceneError(
            "box: lower and upper must be three numbers each and cells three whole numbers, got "
            f"{shown(lower)}, {shown(upper)}, {shown(cells)}."
        ) from None
    finite = a.shape == b.shape == (3,) and bool(np.isfinite([a, b]).all())
    if not finite or not np.all(b > a):
        raise SceneError(
            "box: lower and upper must be three finite numbers each, and upper must exceed lower "
            f"in all of x, y, z; got {shown(lower)}, {shown(upper)}."
        )
    if len(counts) != 3 or min(counts) < 1:
        raise SceneError(f"box: cells must be three whole numbers ≥ 1, got {shown(cells)}.")
    if prod(counts) > MOST:
        raise SceneError(f"box: {shown(cells)} cells are more than the {MOST} that are counted.")
    kinds = {kind.name: kind for kind in CELLS}
    if not isinstance(cell, str) or cell not in kinds:
        raise SceneError(f"box: cell must be one of {sorted(kinds)}, got {shown(cell)}.")
    try:
        mesh = dmesh.create_box(
            comm, [a, b], counts, kinds[cell], ghost_mode=dmesh.GhostMode.shared_facet
        )
    except RuntimeError as error:  # on all ranks: what is too small for DOLFINx
        raise SceneError(f"box: from {lower} m to {upper} m: {error}.") from None
    domain = Domain(mesh)
    for axis, letter in enumerate("xyz"):
        tol = 1e-9 * (b[axis] - a[axis])
        for side, value in (("0", a[axis]), ("1", b[axis])):
            domain = domain.with_facets(letter + side, _on_plane(axis, value, tol))
    return domain


def from_arrays(
    points: npt.ArrayLike,
    cells: npt.ArrayLike,
    cell: str = "hexahedron",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Domain:
    """A domain of given cells, without names. Collective.

    Args:
        points: Corner positions, shape (points, 3) [m]; empty on all ranks but one.
        cells: Point numbers, shape (cells, 8) or (cells, 27) of hexahedra, (cells, 4) or
            (cells, 10) of tetrahedra: corners first, those of a hexahedron in DOLFINx's order (x
            fastest, then y, then z) or round its bottom and then round its top, as Abaqus, VTK,
            gmsh and meshio have them; then, in any order, the nodes in the middles of its edges,
            and of a hexahedron's faces and itself. Empty on all ranks but one.
        cell: "hexahedron" or "tetrahedron".
        comm: Communicator of the mesh.

    Raises:
        SceneError: If shapes, kinds or numbers do not fit, a cell is there twice, two ranks give
            the same cells, other nodes than corners are not where they should be, or cells are
            inverted or flat.
    """
    if not isinstance(cell, str) or cell not in CORNERS:
        raise SceneError(f"from_arrays: cell must be one of {sorted(CORNERS)}, got {shown(cell)}.")
    communicator("from_arrays", comm)
    agree(comm, _misfit(points, cells, cell))
    x = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    table = np.asarray(cells)
    width = comm.allreduce(table.shape[1] if table.size else 0, op=MPI.MAX) or CORNERS[cell]
    rows: Ints = table.astype(np.int64).reshape(-1, width)
    given = comm.allgather(hashlib.sha1(rows.tobytes()).digest() if rows.size else b"")
    agree(comm, _repeated(given))
    rows, problem = in_dolfinx_order(x, rows, cell) if rows.size else (rows, None)
    agree(comm, problem)
    element = basix.ufl.element("Lagrange", cell, degree_of(cell, width), shape=(3,))
    return Domain(compat.create_mesh(comm, rows, x, ufl.Mesh(element)))


def _repeated(given: Sequence[bytes]) -> str | None:
    """Faults of the cells of ranks, by their digests, empty where there are none."""
    some = [rank for rank, digest in enumerate(given) if digest]
    if not some:
        return "from_arrays: there are no cells."
    for rank in some:
        if (first := given.index(given[rank])) < rank:
            return (
                f"from_arrays: ranks {first} and {rank} give the same cells, so that each would be "
                "there twice. Give points and cells on one rank, and empty arrays on all others."
            )
    return None


def _misfit(points: npt.ArrayLike, cells: npt.ArrayLike, cell: str) -> str | None:
    """Faults of the arrays of this rank, None if none."""
    try:
        x, rows = np.asarray(points), np.asarray(cells)
    except ValueError:
        return "from_arrays: points and cells must be arrays; some of their rows differ in length."
    sought = ("points", x, "iuf", (3,)), ("cells", rows, "iu", widths(cell))
    for name, given, kinds, columns in sought:
        kind = "whole numbers" if kinds == "iu" else "real numbers"
        fits = given.ndim == 2 and given.shape[1] in columns
        if given.size and (given.dtype.kind not in kinds or not fits):
            shapes = " or ".join(f"(n, {width})" for width in columns)
            advice = advice_on(cell, given.shape[1]) if name == "cells" and given.ndim == 2 else ""
            return (
                f"from_arrays: {name} must be {kind} of shape {shapes}, got {given.dtype} of "
                f"shape {given.shape}.{advice}"
            )
    for name, array in (("points", points), ("cells", cells)):
        if np.ma.is_masked(array):
            return f"from_arrays: some of the {name} are masked; fill them, or leave them out."
    if not np.isfinite(x.astype(np.float64)).all():
        return "from_arrays: points must be finite."
    if rows.size == 0:
        return None
    if rows.min() < 0 or rows.max() >= len(x):
        return f"from_arrays: cells name points outside 0 … {len(x) - 1}."
    _, first, times = np.unique(
        np.sort(rows, axis=1), axis=0, return_index=True, return_counts=True
    )
    if times.max() > 1:
        return f"from_arrays: cell {first[np.argmax(times)]} is there {times.max()} times."
    fault = collapsed(rows[:, : CORNERS[cell]])
    return f"from_arrays: cell {fault[0]} {fault[1]}" if fault else None


def _on_plane(axis: int, value: float, tol: float) -> Marker:
    return lambda x: np.abs(x[axis] - value) < tol

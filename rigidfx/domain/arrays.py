"""How domains are made: of boxes, of arrays, and of the meshes that readers of files find."""

import hashlib
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import prod

import basix.ufl
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI

from rigidfx.base import compat
from rigidfx.base.errors import SceneError, agree, together
from rigidfx.base.inputs import communicator, numbers, shown
from rigidfx.base.taken import check_same
from rigidfx.base.types import Array, Ints
from rigidfx.base.warning import warn
from rigidfx.domain.cell_quality import (
    CORNERS,
    advice_on,
    collapsed,
    degree_of,
    in_dolfinx_order,
    naming,
    widths,
)
from rigidfx.domain.domain import CELLS, KINDS, Domain, EntitySet, Marker, by_corners, replace_sets

MOST = np.iinfo(np.int32).max  # cells of a box


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
    return Domain(_mesh(comm, x, rows, cell))


def _mesh(comm: MPI.Intracomm, points: Array, cells: Ints, kind: str) -> dmesh.Mesh:
    """A mesh of cells whose nodes are in DOLFINx's order. Collective."""
    element = basix.ufl.element("Lagrange", kind, degree_of(kind, cells.shape[1]), shape=(3,))
    return compat.create_mesh(comm, cells, points, ufl.Mesh(element))


Names = dict[int, dict[str, Ints]]


@dataclass
class FileMesh:
    """A mesh and its names, as a reader finds them on rank 0."""

    kind: str  # "hexahedron" or "tetrahedron"
    points: Array  # nodes, shape (nodes, 3) [m]
    cells: Ints  # nodes of each cell in DOLFINx's order, shape (cells, nodes of each)
    # By dimension and name: rows of cells; of facets, edges and vertices the nodes at their
    # corners, shape (entities, corners)
    sets: Names = field(default_factory=lambda: {dim: {} for dim in KINDS})
    notes: list[str] = field(default_factory=list)  # texts of warnings
    # Name of each instance, and the numbers of its elements, one instance after the other as
    # `cells` are; none where a file does not number its cells
    elements: list[tuple[str, Ints]] = field(default_factory=list)


def element_name(elements: Sequence[tuple[str, Ints]], cell: int) -> str:
    """The name of a cell in its file."""
    for instance, own in elements:
        if cell < len(own):
            return f"element {own[cell]}" + (f" of instance '{instance}'" if instance else "")
        cell -= len(own)
    return f"number {cell} of the input"


def read_domain(
    comm: MPI.Intracomm, owner: str, source: str, read: Callable[[], FileMesh]
) -> Domain:
    """The domain of a mesh that `read`, called on rank 0 only, reads, or its error. Collective."""
    communicator(owner, comm)
    mesh = together(comm, owner, lambda: read() if comm.rank == 0 else None)
    told = mesh and (mesh.kind, mesh.cells.shape[1], mesh.sets, mesh.notes, mesh.elements)
    kind, width, sets, notes, elements = comm.bcast(told)
    for note in notes:
        warn(comm, note)
    points = np.empty((0, 3)) if mesh is None else mesh.points
    cells = np.empty((0, width), np.int64) if mesh is None else mesh.cells
    with naming(partial(element_name, elements) if elements else None):
        domain = Domain(_mesh(comm, points, cells, kind))
    found = sets_of(domain.mesh, sets)
    _check_found(domain.mesh, source, sets, found)
    return replace_sets(domain, {(each.name, each.dim): each for each in found})


def sets_of(mesh: dmesh.Mesh, named: Names) -> list[EntitySet]:
    """Sets of a mesh by numbers in its input, the same on all ranks. Collective."""
    found = []
    for name, rows in named[3].items():
        cells = np.flatnonzero(np.isin(mesh.topology.original_cell_index, rows))
        found.append(EntitySet(name, 3, cells.astype(np.int32)))
    for dim in (2, 1, 0):
        entities = by_corners(mesh, dim, named[dim]).items()
        found += [EntitySet(name, dim, own) for name, own in entities]
    return found


def _check_found(mesh: dmesh.Mesh, source: str, named: Names, found: Sequence[EntitySet]) -> None:
    """Refuse facets that bound no cell, and warn of other entities that cells lack. Collective."""
    missed: dict[int, list[str]] = {2: [], 1: []}
    for each in (one for one in found if one.dim < 3):
        corners = named[each.dim][each.name]
        count = len(np.unique(np.sort(corners, axis=1), axis=0))
        owned = np.count_nonzero(each.entities < mesh.topology.index_map(each.dim).size_local)
        if left := count - mesh.comm.allreduce(int(owned)):
            kind = "" if each.dim == 2 else f" {KINDS[each.dim]}"
            missed[max(each.dim, 1)].append(f"'{each.name}' ({left} of {count}{kind})")
    if missed[2]:
        raise SceneError(
            f"{source}: of the facets {', '.join(missed[2])} bound no volume cell of the mesh, "
            "which is made of the cells in physical groups. Leave them out of the group, or put "
            "the volume that they bound into one."
        )
    if missed[1]:
        warn(
            mesh.comm,
            f"{source}: the volume cells in physical groups do not have all edges and vertices of "
            f"{', '.join(missed[1])}: these are left out. Mesh them with the volume (Coherence, "
            "embed), or put the volume that they bound into a group.",
        )


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

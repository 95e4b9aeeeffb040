"""Checks of cells: the order of their nodes, and that none is flat or turned inside out.

DOLFINx integrates with |det J|, so an inverted cell adds volume instead of taking it away. Whatever
the order of its vertices, det J must keep one sign at all integration points of a cell, and cells
on the two sides of a facet must lie on different sides. Programs number the nodes of a cell in
different ways; one order only makes sound cells.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import basix
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.errors import agree
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.base.warning import warn

KINDS = basix.CellType.hexahedron, basix.CellType.tetrahedron
CORNERS = {kind.name: len(basix.geometry(kind)) for kind in KINDS}
ROUND = (0, 1, 3, 2, 4, 5, 7, 6)  # of a hexahedron round its bottom and its top: DOLFINx's order
MOST = 5000  # cells that are looked at

# What to do with cells of so many nodes that are of no kind that is taken.
TWENTY = (
    "Bricks of 20 nodes have none in their faces: give their corners, cells[:, :8], and let the "
    "scene be of second order (order=2)."
)
WEDGES = (
    "Wedges and pyramids are no cells of a domain: mesh the part by tetrahedra or hexahedra alone."
)
ADVICE = {20: TWENTY} | dict.fromkeys((5, 6, 13, 15), WEDGES)

# Shapes of a brick of four, five, six and seven different corners.
SHAPES = ("a tetrahedron", "a pyramid", "a wedge", "a brick with an edge of no length")


@cache
def widths(cell: str) -> tuple[int, int]:
    """Numbers of nodes that a cell may have."""
    second = basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], 2, basix.LagrangeVariant.equispaced
    )
    return CORNERS[cell], second.dim


def advice_on(cell: str, width: int) -> str:
    """The remedy for cells of so many nodes, which are not of this kind; empty if unknown."""
    other = next((kind for kind in CORNERS if kind != cell and width in widths(kind)), "")
    advice = ADVICE.get(width, f"Cells of {width} nodes are of another kind: cell={other!r}.")
    return f" {advice}" if other or width in ADVICE else ""


def collapsed(corners: Ints) -> tuple[int, str] | None:
    """The first cell that names a corner twice, and a text of its fault; None if there is none."""
    ordered = np.sort(corners, axis=1)
    same = (np.diff(ordered, axis=1) == 0).sum(axis=1)
    if not same.any():
        return None
    at = int(np.flatnonzero(same)[0])
    names, times = np.unique(ordered[at], return_counts=True)
    shape = f"it is {SHAPES[len(names) - 4]}. {WEDGES}" if len(names) >= 4 else "it is flat."
    return at, f"names node {names[times.argmax()]} {times.max()} times: {shape}"


def degree_of(cell: str, width: int) -> int:
    """Order of the geometry of cells with so many nodes."""
    return 1 + widths(cell).index(width)


def in_dolfinx_order(x: Array, rows: Ints, cell: str) -> tuple[Ints, str | None]:
    """Cells with their nodes in DOLFINx's order, and the fault of the given one, or None.

    Points have shape (points, 3) [m], and `rows` those of each cell, corners first.
    """
    corners = CORNERS[cell]
    some = rows[:: max(1, len(rows) // MOST)]
    if cell == "hexahedron" and _sound(x, some[:, ROUND]) > _sound(x, some[:, :corners]):
        rows, some = (np.hstack([r[:, ROUND], r[:, corners:]]) for r in (rows, some))
    if rows.shape[1] == corners:
        return rows, None
    order = _order_of_others(x, some, cell)
    if order is None:
        return rows, (
            f"from_arrays: after its {corners} corners a {cell}'s nodes must be those in the "
            f"middles of its {_others(cell)}, in the same order in all cells, but in most cells "
            "these are not what lies there. Give the corners alone, "
            f"cells[:, :{corners}] (read_inp: corners=True), and let the scene be of second order "
            "(order=2)."
        )
    return np.hstack([rows[:, :corners], rows[:, corners:][:, order]]), None


def _sound(x: Array, rows: Ints) -> int:
    """How many hexahedra have a volume of one sign at all corners, in DOLFINx's order."""
    X = x[rows].reshape(-1, 2, 2, 2, 3)  # by z, y, x
    along = [np.diff(X, axis=axis) for axis in (3, 2, 1)]
    det = np.linalg.det(np.stack(np.broadcast_arrays(*along), axis=-1)).reshape(len(rows), -1)
    return int(np.count_nonzero((det > 0).all(axis=1) | (det < 0).all(axis=1)))


def _order_of_others(x: Array, rows: Ints, cell: str) -> Ints | None:
    """Columns after the corners, in DOLFINx's order; None if most cells have no common one.

    A node belongs where the middle of an edge, a face or the cell is nearest. In a few cells that
    may be another one, as they are curved; whether they are sound is for det J to say.
    """
    corners = CORNERS[cell]
    topology = basix.topology(getattr(basix.CellType, cell))
    parts = topology[1] if cell == "tetrahedron" else [p for dim in topology[1:] for p in dim]
    middles = np.stack([x[rows[:, part]].mean(axis=1) for part in parts], axis=1)
    apart = np.linalg.norm(middles[:, :, None] - x[rows[:, None, corners:]], axis=-1)
    orders, times = np.unique(apart.argmin(axis=2), axis=0, return_counts=True)
    order = orders[np.argmax(times)].astype(np.int64)
    usual = 2 * times.max() > len(rows)
    return order if usual and len(set(order.tolist())) == len(parts) else None


def _others(cell: str) -> str:
    """Where the nodes are that are no corners."""
    return "edges" if cell == "tetrahedron" else "edges and faces, and in its own middle"


FLAT = 1e-12  # det J below this part of (cell diameter)³ counts as zero volume
FINEST = 6  # degree of the finest rule over cells: that of masses in scenes of second order
CHUNK = 20_000  # cells looked at in one go, to bound the memory

_names: list[Callable[[int], str]] = []  # of cells that are read now


@contextmanager
def naming(cell: Callable[[int], str] | None) -> Iterator[None]:
    """Make messages name cells as their file does meanwhile, by numbers in the input."""
    before = [*_names]
    _names[:] = [cell] if cell else []
    try:
        yield
    finally:
        _names[:] = before


def determinants(mesh: dmesh.Mesh, cells: Indices, points: Array) -> tuple[Array, Array]:
    """Det J at reference points, shape (cells, points), and each cell's diameter cubed."""
    element = basix.create_element(
        basix.ElementFamily.P,
        basix.CellType[mesh.topology.cell_type.name],
        coordinate_map(mesh).degree,
        basix.LagrangeVariant.equispaced,
    )
    table = element.tabulate(1, points)[1:4, :, :, 0]
    x = mesh.geometry.x[cell_geometry_dofs(mesh)[cells]]
    J = np.einsum("jpn,cni->cpij", table, x, optimize=True)
    extent = x.max(axis=1) - x.min(axis=1)
    return np.linalg.det(J), np.linalg.norm(extent, axis=1) ** 3


def check_points(cell: basix.CellType, degree: int) -> Array:
    """Corners of the reference cell and the points of a Gauss rule, shape (points, 3)."""
    gauss, _ = basix.make_quadrature(cell, 2 * degree)
    return np.vstack([basix.geometry(cell), gauss])


def _folded(mesh: dmesh.Mesh) -> Indices:
    """One cell of each pair of neighbouring simplices that lie on the same side of their facet."""
    topology = mesh.topology
    topology.create_entities(2)
    topology.create_connectivity(2, 3)
    topology.create_connectivity(2, 0)
    topology.create_connectivity(3, 0)
    facet_cells = topology.connectivity(2, 3)
    inner = np.flatnonzero(np.diff(facet_cells.offsets) == 2).astype(np.int32)
    if inner.size == 0:
        return inner
    first = facet_cells.offsets[inner]
    pairs = np.stack([facet_cells.array[first], facet_cells.array[first + 1]], axis=1)
    vertices = dmesh.entities_to_geometry(mesh, 2, inner)
    x = mesh.geometry.x
    corner = x[vertices]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    corners_of_cell = dmesh.entities_to_geometry(mesh, 3, pairs.reshape(-1))[:, :4]
    centre = x[corners_of_cell].mean(axis=1).reshape(-1, 2, 3)
    side = np.einsum("fci,fi->fc", centre - corner[:, :1], normal)
    return pairs[side[:, 0] * side[:, 1] >= 0, 0]


def volume(mesh: dmesh.Mesh) -> float:
    """Volume of all cells of all ranks [m³]. Collective."""
    cell = basix.CellType[mesh.topology.cell_type.name]
    points, weights = basix.make_quadrature(cell, 3 * coordinate_map(mesh).degree)
    local, total = mesh.topology.index_map(3).size_local, 0.0
    for start in range(0, local, CHUNK):
        cells = np.arange(start, min(start + CHUNK, local), dtype=np.int32)
        total += float((np.abs(determinants(mesh, cells, points)[0]) @ weights).sum())
    return mesh.comm.allreduce(total)


def check_cells(mesh: dmesh.Mesh) -> None:
    """Refuse inverted or flat cells; warn of cells that are so at a corner. Collective."""
    finite = bool(np.isfinite(mesh.geometry.x).all())
    agree(mesh.comm, None if finite else "The mesh has nodes whose coordinates are not finite.")
    local = mesh.topology.index_map(3).size_local
    cell = basix.CellType[mesh.topology.cell_type.name]
    at_corners = cell_geometry_dofs(mesh)[:local, : len(basix.geometry(cell))]
    fault = collapsed(np.asarray(mesh.geometry.input_global_indices)[at_corners])
    agree(
        mesh.comm,
        fault and f"Cell {mesh.topology.original_cell_index[fault[0]]} of the input {fault[1]}",
    )
    points, sign = check_points(cell, coordinate_map(mesh).degree), np.empty(local)
    broken = np.empty(local, dtype=bool)
    for start in range(0, local, CHUNK):
        cells = np.arange(start, min(start + CHUNK, local), dtype=np.int32)
        det, size = determinants(mesh, cells, points)
        sign[cells] = np.sign(det[:, -1])
        broken[cells] = (det * sign[cells, None]).min(axis=1) <= FLAT * size
    cornered = np.flatnonzero(broken).astype(np.int32)
    if cornered.size:
        det, size = determinants(mesh, cornered, basix.make_quadrature(cell, FINEST)[0])
        broken[cornered] = (det * sign[cornered, None]).min(axis=1) <= FLAT * size
        cornered = cornered[~broken[cornered]]
    if mesh.topology.cell_type == dmesh.CellType.tetrahedron:
        # Any order of a tetrahedron's vertices is admissible, so its sign says nothing.
        bad = np.union1d(np.flatnonzero(broken), _folded(mesh))
    else:
        # Hexahedra keep their order of vertices: those that differ from the rest are inverted.
        usual = mesh.comm.allreduce(sign.sum())
        bad = np.flatnonzero(broken | (sign * usual < 0))
    all_bad = mesh.comm.allreduce(local == len(bad), op=MPI.LAND)
    problem = None
    if bad.size:
        problem = (
            f"The mesh has inverted or flat cells, {_first(mesh, bad)}: det J changes its sign or "
            "vanishes there. Repair the mesh, or make it anew with cells of another size."
        )
        if _names and coordinate_map(mesh).degree > 1:
            problem += " By their corners, with straight edges: read_inp(…, corners=True)."
        if all_bad:
            problem += (
                " As all cells are, their nodes may be in another order than DOLFINx's: that of a "
                "hexahedron's corners is x fastest, then y, then z. from_arrays knows others, too."
            )
    agree(mesh.comm, problem)
    told = mesh.comm.allgather(_first(mesh, cornered) if cornered.size else "")
    if first := next(filter(None, told), ""):
        warn(
            mesh.comm,
            f"{mesh.comm.allreduce(len(cornered))} cells are inside out or flat at a corner, "
            f"{first}. Integrals are right, as det J has one sign at all of their points, but "
            "strains are less exact there. More regular cells are better.",
        )


def _first(mesh: dmesh.Mesh, cells: npt.NDArray[np.integer[Any]]) -> str:
    """The first of some local cells: its place, and its number in the input."""
    x, y, z = mesh.geometry.x[cell_geometry_dofs(mesh)[cells[0]]].mean(axis=0)
    number = mesh.topology.original_cell_index[cells[0]]
    name = _names[-1](int(number)) if _names else f"number {number} of the input"
    return f"the first around ({x:.6g}, {y:.6g}, {z:.6g}) m, {name}"

"""Checks of a mesh: every cell has a volume, none is turned inside out.

DOLFINx integrates with |det J|, so an inverted cell goes unnoticed and adds volume instead of
taking it away. Two tests find one whatever the order of its vertices: det J must keep one sign at
all integration points of a cell, and the cells on the two sides of a facet must lie on different
sides. Another sign at a corner alone falsifies no integral, and is told.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import basix
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from rigidfx.base.compat import cell_geometry_dofs, coordinate_map
from rigidfx.base.errors import agree
from rigidfx.base.types import Array, Indices
from rigidfx.base.warning import warn
from rigidfx.domain.node_orders import collapsed

FLAT = 1e-12  # det J below this part of (cell diameter)³ counts as zero volume
FINEST = 6  # degree of the finest rule over cells: that of masses in scenes of second order
CHUNK = 20_000  # cells looked at in one go, to bound the memory

_names: list[Callable[[int], str]] = []  # of cells that are read now


@contextmanager
def naming(cell: Callable[[int], str]) -> Iterator[None]:
    """Make messages name cells as their file does meanwhile.

    Args:
        cell: The name of a cell by its number in the input, known on all ranks.
    """
    _names.append(cell)
    try:
        yield
    finally:
        _names.pop()


def determinants(mesh: dmesh.Mesh, cells: Indices, points: Array) -> tuple[Array, Array]:
    """Det J at reference points, shape (cells, points), and each cell's diameter cubed.

    Args:
        mesh: A 3D mesh of hexahedra or tetrahedra.
        cells: Local cells.
        points: Points of the reference cell, shape (points, 3).
    """
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
    """Volume of all cells of all ranks [m³]. Collective.

    Args:
        mesh: A 3D mesh of hexahedra or tetrahedra.
    """
    cell = basix.CellType[mesh.topology.cell_type.name]
    points, weights = basix.make_quadrature(cell, 3 * coordinate_map(mesh).degree)
    local, total = mesh.topology.index_map(3).size_local, 0.0
    for start in range(0, local, CHUNK):
        cells = np.arange(start, min(start + CHUNK, local), dtype=np.int32)
        total += float((np.abs(determinants(mesh, cells, points)[0]) @ weights).sum())
    return mesh.comm.allreduce(total)


def check_cells(mesh: dmesh.Mesh) -> None:
    """Refuse meshes with inverted or flat cells; warn of cells that are so at a corner. Collective.

    Args:
        mesh: A 3D mesh of hexahedra or tetrahedra.

    Raises:
        SceneError: On all ranks, naming one offending cell by its place and input number.
    """
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

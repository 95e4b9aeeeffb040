"""Which parts of a mesh are thin, with one or two layers of cells across?

First-order cells cannot bend: a straight edge turns bending into shear, and a tetrahedron has one
strain for all of its volume. Something slender that is one or two of them thick is too stiff, by a
third for a 10:1 cantilever of cubes (tip deflection 0.64 of theory), five thousandfold for a plate
of 1:1000.

The rule, for each connected part (through facets):

* It is one layer thick if at least 95 % of its cells have all their vertices on its boundary, two
  if as many have at least one there (three by three cells across: 8 of 9).
* It is slender if the diagonal of its box is more than 15 times 2V/A, V its volume, A its surface:
  a plate is as thick as 2V/A, a bar twice that, a cube 3·2V/A. So a square bar counts from about 7
  times its thickness on, a square plate from about 10 times.

A block with a thin appendix is not found; a frame of thin bars is.
"""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI

from rigidfx.domain.connected import ConnectedParts, connected_parts

__all__ = ["ThinPart", "thin_parts"]

Array = npt.NDArray[np.float64]

NEARLY_ALL = 0.95  # of a part's cells
SLENDER = 15.0  # diagonal over 2V/A


@dataclass(frozen=True)
class ThinPart:
    """A slender part of few cells across.

    Attributes:
        place: Where it is, for messages.
        layers: Layers of cells across it, 1 or 2.
        slenderness: Diagonal of its box over 2V/A.
    """

    place: str
    layers: int
    slenderness: float


def thin_parts(mesh: dmesh.Mesh) -> list[ThinPart]:
    """The slender parts of one or two layers of cells, in the order of the mesh file. Collective.

    Args:
        mesh: A mesh of hexahedra or tetrahedra.
    """
    parts = connected_parts(mesh, 2)
    owned = mesh.topology.index_map(3).size_local
    part = parts.of_cell[:owned]
    outside = _on_boundary(mesh)[_vertices(mesh, owned)]
    volume, surface = _volumes(mesh, owned), _surfaces(mesh, parts)
    sums = np.stack(
        [
            np.bincount(part, weights, minlength=parts.count)
            for weights in (None, outside.all(axis=1), outside.any(axis=1), volume)
        ]
        + [surface]
    )
    mesh.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    cells, one, two, V, A = sums
    slenderness = np.linalg.norm(parts.upper - parts.lower, axis=1) * A / (2 * V)
    return [
        ThinPart(parts.place(k), 1 if one[k] >= NEARLY_ALL * cells[k] else 2, float(slenderness[k]))
        for k in np.flatnonzero((slenderness > SLENDER) & (two >= NEARLY_ALL * cells))
    ]


def _vertices(mesh: dmesh.Mesh, owned: int) -> npt.NDArray[np.int32]:
    """Vertices of each owned cell, shape (cells, vertices)."""
    mesh.topology.create_connectivity(3, 0)
    graph = mesh.topology.connectivity(3, 0)
    return np.asarray(graph.array.reshape(-1, 4 if _simplex(mesh) else 8)[:owned])


def _simplex(mesh: dmesh.Mesh) -> bool:
    return bool(mesh.topology.cell_type == dmesh.CellType.tetrahedron)


def _corners(mesh: dmesh.Mesh, dim: int, entities: npt.NDArray[np.int32]) -> Array:
    """Corners of straight facets or cells, shape (entities, corners, 3) [m]."""
    count = {3: 4, 2: 3} if _simplex(mesh) else {3: 8, 2: 4}
    if entities.size == 0:  # a rank may own nothing, which DOLFINx divides by
        return np.empty((0, count[dim], 3))
    nodes = dmesh.entities_to_geometry(mesh, dim, entities).reshape(-1, count[dim])
    return np.asarray(mesh.geometry.x[nodes])


def _boundary_facets(mesh: dmesh.Mesh) -> npt.NDArray[np.int32]:
    """Owned facets of one cell."""
    mesh.topology.create_connectivity(2, 3)
    return np.asarray(dmesh.exterior_facet_indices(mesh.topology), dtype=np.int32)


def _on_boundary(mesh: dmesh.Mesh) -> npt.NDArray[np.bool_]:
    """Whether each local vertex is on the boundary. Collective."""
    facets = _boundary_facets(mesh)
    marks = la.vector(mesh.topology.index_map(0), 1, dtype=np.float64)
    mesh.topology.create_connectivity(2, 0)
    marks.array[dmesh.compute_incident_entities(mesh.topology, facets, 2, 0)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    marks.scatter_forward()
    return np.asarray(marks.array > 0)


def _volumes(mesh: dmesh.Mesh, owned: int) -> Array:
    """Volume of each owned cell, straight edges taken, shape (cells,) [m³]."""
    cells = np.arange(owned, dtype=np.int32)
    x = _corners(mesh, 3, cells)
    if _simplex(mesh):
        return np.asarray(np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6)
    edges = x[:, [1, 2, 4]] - x[:, :1], x[:, [6, 5, 3]] - x[:, 7:]  # two opposite corners
    return np.asarray(sum(np.abs(np.linalg.det(e)) for e in edges) / 2)


def _surfaces(mesh: dmesh.Mesh, parts: ConnectedParts) -> Array:
    """Area of this rank's boundary facets of each part, shape (parts,) [m²]."""
    facets = _boundary_facets(mesh)
    x = _corners(mesh, 2, facets)
    # Of a quadrilateral, numbered as in a grid, twice the half on one side of a diagonal.
    cross = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    half = 0.5 if _simplex(mesh) else 1.0
    area = half * np.linalg.norm(cross, axis=1)
    return np.asarray(np.bincount(parts.of_entity[facets], area, parts.count), dtype=np.float64)

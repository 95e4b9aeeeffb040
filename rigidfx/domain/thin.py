"""Which parts of a mesh are too slender for first-order cells as long as theirs?

First-order cells cannot bend: a straight edge turns bending into shear. Bending hexahedra of length
ℓ in something of thickness t takes 1 + ½ (ℓ/t)² times the energy (ν = 0), however many of them are
across. Tip deflections of cantilevers over theory, ν = 0.3:

    10 × 1 × 1   10 × 1 × 1 cells 0.65, 10 × 2 × 2 cells 0.69, 10 × 3 × 3 cells 0.70,
                 20 × 2 × 2 cells 0.88, 20 × 3 × 3 cells 0.89
    1 × 1 × 0.001  10 × 10 × 1 and 10 × 10 × 2 cells 2.6e-4, second-order cells 0.94

    10 × 1 × 1   20 × 1 × 1 cells 0.80, 40 × 1 × 1 cells 0.85, 80 × 1 × 1 cells 0.86

Tetrahedra, whose strain is constant, are worse still: 80 × 1 × 1 boxes of six each leave 0.29. The
rule, for each connected part (through facets) of volume V, surface A, diagonal D of its box and
mean length ℓ of its cells:

* It is slender if D is more than 15 times 2V/A. A plate is as thick as 2V/A, a bar as 4V/A, a cube
  as 6V/A: a square bar counts from some 7 times its thickness on, a square plate from 9.
* Its cells are long if ℓ > 0.7 t, which costs a fifth of the deflection. Its thickness t is that of
  the cuboid with the same V, A and D, whose edges solve x³ - √(D² + A) x² + ½A x - V = 0.
* A cell is as long as its longest edge. Edges of a hexahedron that cross a single layer, from one
  boundary facet to the opposite one, do not count: across a layer nothing bends.

A block with a thin appendix is not found; a frame of thin bars is, and counts as thinner by up to a
half.
"""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import la
from mpi4py import MPI

from rigidfx.base.types import Array, Bools, Indices
from rigidfx.domain.connected import ConnectedParts, connected_parts

__all__ = ["ThinPart", "thin_parts"]


SLENDER = 15.0  # diagonal over 2V/A
LONG = 0.7  # length of cells over thickness


@dataclass(frozen=True)
class ThinPart:
    """A slender part of cells that lock in bending.

    Attributes:
        place: Where it is, for messages.
        thickness: About how thick it is [m].
        length: Mean length of its cells [m].
    """

    place: str
    thickness: float
    length: float

    @property
    def deflection(self) -> float:
        """Rough part of its deflection in bending that hexahedra leave: 1/(1 + ½ (ℓ/t)²)."""
        return 1 / (1 + 0.5 * (self.length / self.thickness) ** 2)


def thin_parts(mesh: dmesh.Mesh, strained: Bools) -> list[ThinPart]:
    """The slender parts whose first-order cells lock, in the order of the mesh file. Collective.

    Args:
        mesh: A mesh of hexahedra or tetrahedra.
        strained: For each owned cell, whether it counts; the others are rigid, and end a part.
    """
    owned = strained.size
    among = la.vector(mesh.topology.index_map(3), 1, dtype=np.float64)
    among.array[:owned] = strained
    among.scatter_forward()
    parts = connected_parts(mesh, 2, among.array > 0)
    part, outside = parts.of_cell[:owned], _on_boundary(mesh, strained)
    x = _corners(mesh, 3, np.arange(owned, dtype=np.int32))
    per_cell = np.ones(owned), _lengths(mesh, x, outside), _volumes(x)
    sums = np.stack([np.bincount(part, values * strained, parts.count) for values in per_cell])
    sums = np.vstack([sums, _surfaces(mesh, parts, outside)])
    mesh.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    out = []
    for k in np.flatnonzero(sums[0]):  # a part of rigid cells, or of none, has no sums
        length, V, A = np.r_[sums[1, k] / sums[0, k], sums[2:, k]]
        D = float(np.linalg.norm(parts.upper[k] - parts.lower[k]))
        if D > SLENDER * 2 * V / A and length > LONG * (t := _thickness(V, A, D)):
            out.append(ThinPart(parts.place(int(k)), t, float(length)))
    return out


def _thickness(V: float, A: float, D: float) -> float:
    """Shortest edge of the cuboid of a volume [m³], surface [m²] and diagonal [m]."""
    edges = np.roots([1.0, -np.sqrt(D**2 + A), A / 2, -V])
    return float(edges.real.min())


def _simplex(mesh: dmesh.Mesh) -> bool:
    return bool(mesh.topology.cell_type == dmesh.CellType.tetrahedron)


def _corners(mesh: dmesh.Mesh, dim: int, entities: Indices) -> Array:
    """Corners of straight facets or cells, shape (entities, corners, 3) [m]."""
    count = {3: 4, 2: 3} if _simplex(mesh) else {3: 8, 2: 4}
    if entities.size == 0:  # a rank may own nothing, which DOLFINx divides by
        return np.empty((0, count[dim], 3))
    nodes = dmesh.entities_to_geometry(mesh, dim, entities).reshape(-1, count[dim])
    return np.asarray(mesh.geometry.x[nodes])


# Local vertices at both ends of each edge.
EDGES = {
    4: ((0, 0, 0, 1, 1, 2), (1, 2, 3, 2, 3, 3)),
    8: ((0, 0, 0, 1, 1, 2, 2, 3, 4, 4, 5, 6), (1, 2, 4, 3, 5, 3, 6, 7, 5, 6, 7, 7)),
}


def _edges(x: Array) -> Array:
    """Lengths of the edges of each cell, shape (cells, edges) [m]."""
    a, b = (list(ends) for ends in EDGES[x.shape[1]])
    return np.asarray(np.linalg.norm(x[:, a] - x[:, b], axis=2))


def _lengths(mesh: dmesh.Mesh, x: Array, outside: Bools) -> Array:
    """Longest edge of each owned cell that crosses no single layer, shape (cells,) [m]. Collective.

    Args:
        mesh: A mesh of hexahedra or tetrahedra; edges of tetrahedra cross nothing.
        x: Corners of its owned cells, shape (cells, corners, 3) [m].
        outside: For each local facet, whether it is on the boundary.
    """
    edges = _edges(x)
    if _simplex(mesh):
        return np.asarray(edges.max(axis=1))
    facets = mesh.topology.connectivity(3, 2).array.reshape(-1, 6)[: len(x)]
    at = outside[facets]
    single = at[:, :3] & at[:, :2:-1]  # layers across z, y and x: facets k and 5 - k
    a, b = np.array(EDGES[8])
    along = 2 - np.log2(b - a).astype(int)  # 0, 1, 2: an edge along z, y, x
    return np.asarray(np.where(single[:, along], 0.0, edges).max(axis=1))


def _on_boundary(mesh: dmesh.Mesh, strained: Bools) -> Bools:
    """Whether each local facet is one of a single strained cell. Collective."""
    for dims in ((3, 2), (2, 3)):  # the second is for places of facets
        mesh.topology.create_connectivity(*dims)
    facets = mesh.topology.connectivity(3, 2).array.reshape(-1, 4 if _simplex(mesh) else 6)
    cells = la.vector(mesh.topology.index_map(2), 1, dtype=np.float64)
    cells.array[:] = 0.0
    np.add.at(cells.array, facets[: strained.size][strained].ravel(), 1.0)
    cells.scatter_reverse(la.InsertMode.add)
    cells.scatter_forward()
    return np.asarray(cells.array == 1.0)


def _volumes(x: Array) -> Array:
    """Volume of each cell, straight edges taken, shape (cells,) [m³]."""
    if x.shape[1] == 4:
        return np.asarray(np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6)
    edges = x[:, [1, 2, 4]] - x[:, :1], x[:, [6, 5, 3]] - x[:, 7:]  # at two opposite corners
    return np.asarray(sum(np.abs(np.linalg.det(e)) for e in edges) / 2)


def _surfaces(mesh: dmesh.Mesh, parts: ConnectedParts, outside: Bools) -> Array:
    """Area of this rank's boundary facets of each part, shape (parts,) [m²]."""
    owned = mesh.topology.index_map(2).size_local
    facets = np.flatnonzero(outside[:owned]).astype(np.int32)
    x = _corners(mesh, 2, facets)
    # Of a quadrilateral, numbered as in a grid, twice the half on one side of a diagonal.
    cross = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    half = 0.5 if _simplex(mesh) else 1.0
    area = half * np.linalg.norm(cross, axis=1)
    return np.asarray(np.bincount(parts.of_entity[facets], area, parts.count), dtype=np.float64)

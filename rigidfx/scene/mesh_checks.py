"""Meshes that can be computed with, and give what nobody wanted: warnings when a scene is made.

First-order cells cannot bend: a straight edge turns bending into shear. A connected part is too
slender for cells as long as its own if its diagonal is `SLENDER` times 2V/A, of its volume and
surface, and its cells are longer than `LONG` times its thickness: docs/notes/elements.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import basix
import dolfinx.mesh as dmesh
import numpy as np
from dolfinx import la
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx import effects as fx
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.base.warning import warn
from rigidfx.domain.connected import ConnectedParts, connected_parts, hinges, touching
from rigidfx.domain.domain import Domain, count_between
from rigidfx.effects.base import ANY_SET

DIGITS = 1e-9  # error of a cell's size that is warned of


def warn_of_bending(domain: Domain, strained: Bools) -> None:
    """Warn of slender parts whose first-order cells lock in bending. Collective.

    Of owned cells those count that are strained: in no part named rigid.
    """
    thin = thin_parts(domain.mesh, strained)
    if not thin:
        return
    worst = min(thin, key=lambda part: part.deflection)
    more = f" So are {len(thin) - 1} other parts." if len(thin) > 1 else ""
    simplex = domain.mesh.topology.cell_type == dmesh.CellType.tetrahedron
    instead = "order=2 with mass='consistent'" if simplex else "element='enhanced' or order=2"
    warn(
        domain.comm,
        f"Scene: first-order cells lock in bending: {worst.place}, some {worst.thickness:.3g} m "
        f"thick, is slender and its cells are {worst.length:.3g} m long, which leaves some "
        f"{worst.deflection:.2g} of its deflection.{more} Take {instead}, or cells half "
        "as long as it is thick; more across do not help.",
    )


def warn_of_mesh(domain: Domain, effects: Sequence[fx.Effect], order: int) -> None:
    """Warn of parts that part or swing, of nodes that sets lack, of hidden sizes. Collective."""
    _warn_of_gaps(domain, effects)
    _warn_of_hinges(domain, effects)
    _warn_of_distance(domain)
    if order > 1:
        _warn_of_vertices(domain, effects)


def _warn_of_gaps(domain: Domain, effects: Sequence[fx.Effect]) -> None:
    """Warn of parts that touch others without sharing nodes, and with nothing between them.

    Parts that fly freely on their own are none of these, however near they are. A rigid body that
    has cells of several parts joins them, and a contact between two surfaces keeps them apart.
    Collective.
    """
    parts = connected_parts(domain.mesh, 0)
    if parts.count == 1:
        return
    group = _joined(domain, parts, effects)
    pairs = touching(domain.mesh, parts, group)
    pairs = pairs[:, ~_kept_apart(domain, parts, effects, pairs)]
    if pairs.size == 0:
        return
    loose = ~np.isin(group, group[_held(domain, parts, effects)])
    fall = loose[pairs].any(axis=0)
    first = pairs[:, np.argmax(fall)]
    a, b = first if loose[first[0]] or not loose[first[1]] else first[::-1]
    many = len(np.unique(pairs))
    more = f" In all, {many} parts touch like this." if many > 2 else ""
    follows = (
        "no support or spring holds it: they will part without resistance"
        if fall.any()
        else "no Contact is between them: they slide, part and overlap without resistance"
    )
    warn(
        domain.comm,
        f"Scene: {parts.place(int(a))} touches, or overlaps, {parts.place(int(b))}, but they share "
        f"no nodes, and {follows}.{more} Mesh them as one (glue=True of read_cad, Coherence or "
        "BooleanFragments in gmsh), let a Contact stand between their surfaces, or keep the gap "
        "open.",
    )


def _warn_of_hinges(domain: Domain, effects: Sequence[fx.Effect]) -> None:
    """Warn of parts that share a node or an edge and no facet, unless in one body. Collective."""
    parts = connected_parts(domain.mesh, 2)
    if parts.count == 1:
        return
    named: list[Any] = [e for e in effects if e.is_rigid]
    bodies = [_parts_of_cells(domain, parts, e.where) for e in named]
    found = [
        hinge
        for hinge in hinges(domain.mesh, parts)
        if not any(np.isin(hinge.parts, body).all() for body in bodies)
    ]
    if not found:
        return
    a, b = found[0].parts
    more = f" {len(found) - 1} other pairs of parts do so." if len(found) > 1 else ""
    warn(
        domain.comm,
        f"Scene: {parts.place(a)} and {parts.place(b)} share {found[0]}, and no facet of a cell: "
        "they turn about it without resistance, as a door about its hinge, and stresses there "
        f"grow with each refinement.{more} Let the parts overlap or share a face, and mesh them "
        "as one (glue=True of read_cad, Coherence or BooleanFragments in gmsh); or keep a gap "
        "between them.",
    )


def _warn_of_vertices(domain: Domain, effects: Sequence[fx.Effect]) -> None:
    """Warn of lines of vertices without the nodes between them. Collective."""
    acting = {where: e for e in effects if isinstance(where := getattr(e, "where", None), str)}
    for where, effect in acting.items():
        sets = [domain.sets[where, dim] for dim in (3, 2, 1, 0) if (where, dim) in domain.sets]
        if not sets or sets[0].dim > 0:
            continue
        if between := count_between(domain.mesh, sets[0].entities):
            warn(
                domain.comm,
                f"Scene: {effect.owner} acts on vertices that are both ends of {between} edges, "
                "not on the nodes in the middle of these, which a scene of order=2 has: along a "
                "line it acts on every other node. Name the line by with_edges, or by a group of "
                "curves in gmsh.",
            )


def _warn_of_distance(domain: Domain) -> None:
    """Warn of cells so far from the origin that their size is known to a few digits only.

    A number of size |x| is known to ε|x|, so that lengths h of cells, and with them volumes and
    strains, are known to ε|x|/h: a body 10¹⁵ times its length away loses 2 % of its mass.
    Collective.
    """
    mesh, comm = domain.mesh, domain.comm
    nodes = mesh.geometry.x[cell_geometry_dofs(mesh)[: mesh.topology.index_map(3).size_local]]
    extent = np.ptp(nodes, axis=1).max(axis=1)
    far = comm.allreduce(float(np.abs(nodes).max(initial=0.0)), op=MPI.MAX)
    least = comm.allreduce(float(extent.min(initial=np.inf)), op=MPI.MIN)
    lost = float(np.finfo(np.float64).eps) * far / least
    if lost > DIGITS:
        warn(
            comm,
            f"Scene: the mesh reaches {far:.3g} m from the origin, and its cells are "
            f"{least:.3g} m small: their sizes, masses and strains are known to {lost:.1g} of "
            "themselves only. Move the mesh to the origin; nothing depends on where that is.",
        )


def parts_in_words(domain: Domain, most: int = 8) -> list[str]:
    """A line for each part that shares no nodes with others; none if all is one. Collective."""
    parts = connected_parts(domain.mesh, 0)
    if parts.count == 1:
        return []
    lines = [parts.place(k) for k in range(min(parts.count, most))]
    return lines + ([f"and {parts.count - most} more"] if parts.count > most else [])


def _parts_of_cells(domain: Domain, parts: ConnectedParts, name: str | None) -> Ints:
    """Parts that have cells of a named set; all if it has no name. Collective."""
    if name is None:
        return np.arange(parts.count)
    cells = domain.find(name, (3,), "Rigid").entities
    every = domain.comm.allgather(np.unique(parts.of_cell[cells]))
    return np.unique(np.concatenate(every))


def _parts_of(domain: Domain, parts: ConnectedParts, name: str | None, owner: str) -> Ints:
    """Parts that have entities of a named set; all if it has no name. Collective."""
    if name is None:
        return np.arange(parts.count)
    found = domain.find(name, ANY_SET, owner)
    domain.mesh.topology.create_connectivity(found.dim, 0)
    vertices = dmesh.compute_incident_entities(domain.mesh.topology, found.entities, found.dim, 0)
    marks = np.zeros(parts.count, dtype=np.int32)
    marks[parts.of_entity[vertices]] = 1
    domain.comm.Allreduce(MPI.IN_PLACE, marks, op=MPI.MAX)
    return np.flatnonzero(marks)


def _held(domain: Domain, parts: ConnectedParts, effects: Sequence[fx.Effect]) -> Any:
    """Parts with a support or a spring. Collective."""
    holding: list[Any] = [e for e in effects if e.holds]
    found = [_parts_of(domain, parts, e.where, e.kind) for e in holding]
    return np.unique(np.concatenate([np.empty(0, np.int64), *found]))


def _kept_apart(
    domain: Domain, parts: ConnectedParts, effects: Sequence[fx.Effect], pairs: Any
) -> Bools:
    """Whether a contact is between the two parts of each pair, shape (pairs,). Collective."""
    out = np.zeros(pairs.shape[1], dtype=bool)
    for effect in effects:
        sides = [_parts_of(domain, parts, name, effect.kind) for name in effect.keeps_apart]
        if sides:
            on = [[np.isin(part, side) for part in pairs] for side in sides]
            out |= (on[0][0] & on[1][1]) | (on[0][1] & on[1][0])
    return out


def _joined(domain: Domain, parts: ConnectedParts, effects: Sequence[fx.Effect]) -> Any:
    """A number for each part, the same for those that effects join. Collective."""
    links = [np.empty((2, 0), np.int64)]
    for effect in effects:
        own = [_parts_of(domain, parts, name, effect.kind) for name in effect.joins]
        links += [np.stack([some, np.full(some.size, own[0][0])]) for some in own]
    a, b = np.concatenate(links, axis=1)
    graph = coo_array((np.ones(a.size), (a, b)), (parts.count, parts.count))
    return connected_components(graph, directed=False)[1]


SLENDER = 15.0  # diagonal over 2V/A
LONG = 0.7  # length of cells over thickness


@dataclass(frozen=True)
class ThinPart:
    """A slender part of cells that lock in bending: its thickness, and mean length of cells [m]."""

    place: str
    thickness: float
    length: float

    @property
    def deflection(self) -> float:
        """Rough part of its deflection in bending that hexahedra leave: 1/(1 + ½ (ℓ/t)²)."""
        return 1 / (1 + 0.5 * (self.length / self.thickness) ** 2)


def thin_parts(mesh: dmesh.Mesh, strained: Bools) -> list[ThinPart]:
    """The slender parts whose first-order cells lock, in the order of the mesh file. Collective.

    Owned cells that are not strained are rigid, and end a part.
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


def _ends(corners: int) -> Ints:
    """Local vertices at both ends of each edge of a cell of so many, shape (2, edges)."""
    cell = basix.CellType.tetrahedron if corners == 4 else basix.CellType.hexahedron
    return np.transpose(basix.topology(cell)[1])


def _edges(x: Array) -> Array:
    """Lengths of the edges of each cell, shape (cells, edges) [m]."""
    a, b = _ends(x.shape[1])
    return np.asarray(np.linalg.norm(x[:, a] - x[:, b], axis=2))


def _lengths(mesh: dmesh.Mesh, x: Array, outside: Bools) -> Array:
    """Longest edge of each owned cell that crosses no single layer, shape (cells,) [m]. Collective.

    x are the cells' corners; edges of tetrahedra cross nothing. Of local facets those count that
    are outside: on the boundary.
    """
    edges = _edges(x)
    if _simplex(mesh):
        return np.asarray(edges.max(axis=1))
    facets = mesh.topology.connectivity(3, 2).array.reshape(-1, 6)[: len(x)]
    at = outside[facets]
    single = at[:, :3] & at[:, :2:-1]  # layers across z, y and x: facets k and 5 - k
    a, b = _ends(8)
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

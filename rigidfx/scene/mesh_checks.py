"""Meshes that can be computed with, and give what nobody wanted: warnings when a scene is made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rigidfx import effects as fx
from rigidfx.base.compat import cell_geometry_dofs
from rigidfx.base.types import Bools, Ints
from rigidfx.base.warning import warn
from rigidfx.domain.connected import ConnectedParts, connected_parts, hinges, touching
from rigidfx.domain.domain import Domain
from rigidfx.domain.edges import count_between
from rigidfx.domain.thin import thin_parts

__all__ = ["parts_in_words", "warn_of_bending", "warn_of_mesh"]

DIGITS = 1e-9  # error of a cell's size that is warned of


def warn_of_bending(domain: Domain, strained: Bools) -> None:
    """Warn of slender parts whose first-order cells lock in bending. Collective.

    Args:
        domain: Mesh and names.
        strained: For each owned cell, whether it is in no part named rigid.
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
    """Warn of parts that part or swing, of nodes that sets lack, of hidden sizes. Collective.

    Args:
        domain: Mesh and names.
        effects: All effects of a scene.
        order: Order of its displacement.
    """
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

    Args:
        domain: Mesh and names.
        effects: All effects of a scene.
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
    """Warn of parts that share a node or an edge and no facet. Collective.

    Two parts of one rigid body do not swing, and are left out.

    Args:
        domain: Mesh and names.
        effects: All effects of a scene.
    """
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
    """Warn of lines of vertices without the nodes between them. Collective.

    Args:
        domain: Mesh and names.
        effects: All effects of a scene.
    """
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

    Args:
        domain: Mesh and names.
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
    """A line for each part that shares no nodes with others; none if all is one. Collective.

    Args:
        domain: Mesh and names.
        most: Most lines.
    """
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
    found = domain.find(name, (2, 3, 1, 0), owner)
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

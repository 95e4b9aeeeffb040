"""Cells handed out to the ranks anew, so that named sets, and the rest, are shared alike.

A mesh is divided among ranks by all of its cells. Where a part of them is rigid, all that is left
to compute may be on one rank. If each named set is divided equally, and the cells in none as well,
then whichever of these are rigid, all ranks have as many flexible cells. Each is cut by DOLFINx's
graph partitioner, and its pieces go to the ranks that have most of their neighbours already.

As with `from_arrays`, one rank has the whole mesh for a moment.
"""

from collections.abc import Sequence
from typing import Any

import basix
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
import ufl
from scipy.sparse import coo_array

from rigidfx.base import compat
from rigidfx.base.errors import SceneError
from rigidfx.base.inputs import names, shown
from rigidfx.base.taken import check_same
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.domain.arrays import Names, sets_of
from rigidfx.domain.domain import KINDS, Domain, EntitySet, nodes_of

NOWHERE = -1  # rank of a cell that has none yet


def redistribute(domain: Domain, sets: Sequence[str]) -> Domain:
    """The same mesh with each of some sets of cells divided equally among the ranks. Collective.

    To be called before scenes are made; numbers of cells in files do not change. On one rank the
    domain is returned as it is.

    Args:
        domain: Mesh and names.
        sets: Names of sets of cells, such as those that are `Rigid`. Cells of several count with
            the first of these; those of none are divided equally, too.

    Raises:
        SceneError: If the domain is none, a name is unknown or of no cells, or something is not
            the same on all ranks.
    """
    if not isinstance(domain, Domain):
        raise SceneError(f"redistribute: domain must be a Domain, got {shown(domain)}.")
    wanted = names("redistribute", "sets", sets, "sets of cells")
    comm = domain.comm
    check_same(comm, "redistribute", {"sets": wanted})
    found = [domain.find(name, (3,), "redistribute") for name in wanted]
    if comm.size == 1:
        return domain
    mesh = domain.mesh
    cells, points, groups = _whole_mesh(mesh, found)

    def share(comm: Any, parts: int, kinds: Any, corners: Any) -> Any:
        """DOLFINx's function for the ranks that get each cell of this rank, its owner first."""
        return compat.adjacency(*_destinations(cells, groups, mesh.topology.cell_type, parts))

    element = mesh.ufl_domain().ufl_coordinate_element()
    new = compat.create_mesh(comm, cells, points, ufl.Mesh(element), share)
    named: Names = {dim: {} for dim in KINDS}
    for each in domain.sets.values():
        named[each.dim][each.name] = _numbers(mesh, each)
    return Domain(new, sets_of(new, named))


def _whole_mesh(mesh: dmesh.Mesh, sets: Sequence[EntitySet]) -> tuple[Ints, Array, Ints]:
    """Nodes of all cells in the file's order, points, and each cell's group, on rank 0. Collective.

    The group is the number of the first of the sets that the cell is in, or that of sets.
    """
    owned, known = mesh.topology.index_map(3).size_local, mesh.geometry.index_map()
    group = np.full(owned, len(sets), dtype=np.int64)
    for k in reversed(range(len(sets))):
        group[sets[k].entities[sets[k].entities < owned]] = k
    nodes = compat.cell_geometry_dofs(mesh)[:owned]
    rows = np.c_[
        mesh.topology.original_cell_index[:owned],
        group,
        known.local_to_global(nodes.reshape(-1)).reshape(nodes.shape),
    ].astype(np.int64)
    gathered = mesh.comm.gather((rows, mesh.geometry.x[: known.size_local]))
    if gathered is None:
        return rows[:0, 2:], np.empty((0, 3)), group[:0]
    rows, points = (np.concatenate(parts) for parts in zip(*gathered, strict=True))
    rows = rows[np.argsort(rows[:, 0])]
    return rows[:, 2:].copy(), points, rows[:, 1]


def _destinations(
    cells: Ints, groups: Ints, kind: dmesh.CellType, ranks: int
) -> tuple[Indices, Indices]:
    """The rank of each cell, then those of cells across its facets; and where each cell's begin."""
    a, b = _neighbours(cells, kind)
    owner = np.full(len(cells), NOWHERE)
    for group in np.unique(groups)[::-1]:  # first those in no set
        own = np.flatnonzero(groups == group)
        piece = _pieces(own, a, b, len(cells), ranks)
        owner[own] = _ranks_of_pieces(own, piece, owner, a, b, ranks)[piece]
    cell, rank = np.concatenate([a, b]), owner[np.concatenate([b, a])]
    others = rank != owner[cell]
    seen = np.unique(cell[others] * ranks + rank[others])
    order = np.argsort(np.r_[np.arange(len(cells)), seen // ranks], kind="stable")
    counts = 1 + np.bincount(seen // ranks, minlength=len(cells))
    offsets = np.r_[0, np.cumsum(counts)]
    return np.r_[owner, seen % ranks][order].astype(np.int32), offsets.astype(np.int32)


def _neighbours(cells: Ints, kind: dmesh.CellType) -> tuple[Ints, Ints]:
    """Pairs of cells that share a facet."""
    corners = np.array(basix.topology(getattr(basix.CellType, kind.name))[2])
    facets = np.sort(cells[:, corners].reshape(-1, corners.shape[1]), axis=1)
    order = np.lexsort(facets.T)
    same = (facets[order[1:]] == facets[order[:-1]]).all(axis=1)
    return order[:-1][same] // len(corners), order[1:][same] // len(corners)


def _pieces(own: Ints, a: Ints, b: Ints, cells: int, ranks: int) -> Ints:
    """Some of the cells, cut into as many pieces as there are ranks: the piece of each."""
    place = np.full(cells, NOWHERE)
    place[own] = np.arange(own.size)
    inside = (place[a] >= 0) & (place[b] >= 0)
    i, j = place[a[inside]], place[b[inside]]
    if own.size <= ranks or not i.size:
        return np.arange(own.size) * ranks // own.size
    row, column = np.r_[i, j], np.r_[j, i]
    graph = coo_array((np.ones(row.size), (row, column)), 2 * (own.size,)).tocsr()
    return compat.partition(graph.indices.astype(np.int64), graph.indptr, ranks)


def _ranks_of_pieces(
    own: Ints, piece: Ints, owner: Ints, a: Ints, b: Ints, ranks: int
) -> npt.NDArray[Any]:
    """A rank for each piece: with as many facets between those of a rank as can be."""
    from scipy.optimize import linear_sum_assignment  # takes 0.1 s to import

    of_cell = np.full(owner.size, NOWHERE)
    of_cell[own] = piece
    shared = np.zeros((ranks, ranks))
    for one, other in ((a, b), (b, a)):
        meets = (of_cell[one] >= 0) & (owner[other] >= 0)
        np.add.at(shared, (of_cell[one[meets]], owner[other[meets]]), 1.0)
    return np.asarray(linear_sum_assignment(-shared)[1])


def _numbers(mesh: dmesh.Mesh, entities: EntitySet) -> Ints:
    """Numbers of its cells or of the corners of others, as `sets_of` takes them. Collective."""
    dim = entities.dim
    own = entities.entities[entities.entities < mesh.topology.index_map(dim).size_local]
    if dim == 3:
        return np.concatenate(mesh.comm.allgather(mesh.topology.original_cell_index[own]))
    corners = len(basix.topology(getattr(basix.CellType, mesh.topology.cell_type.name))[dim][0])
    nodes = nodes_of(mesh, dim, own)[:, :corners]
    rows = mesh.geometry.index_map().local_to_global(nodes.reshape(-1)).reshape(nodes.shape)
    return np.concatenate(mesh.comm.allgather(rows))

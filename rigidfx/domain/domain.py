"""A mesh with its named parts.

A name stands for a set of cells, facets, edges or vertices; a scene refers to names. A domain never
changes; `with_cells`, `with_facets`, `with_edges` and `with_vertices` return a new one that knows
one name more.

A mesh never goes while an exception is under way: mpi4py 4.0, called for its communicator then,
takes that error for its own and keeps a lock, for which the process waits at its end. Function
spaces and forms on a mesh may be the last to hold it. So meshes are kept here, and those that
nothing else refers to go when the next domain is made or dropped, or at the process's end. A
finaliser is as good a time: in it Python sets exceptions aside.
"""

from __future__ import annotations

import atexit
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
from dolfinx import la
from mpi4py import MPI

from rigidfx.base import compat
from rigidfx.base.errors import SceneError, agree, together
from rigidfx.base.inputs import shown
from rigidfx.base.taken import take_fields
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.base.warning import warn
from rigidfx.domain.cell_quality import check_cells

Marker = Callable[[Array], Bools]

KINDS = {3: "cells", 2: "facets", 1: "edges", 0: "vertices"}
CHORDS = " Straight edges leave a curve: let the marker allow for that, or curve cells (order=2)."
CELLS = {dmesh.CellType.hexahedron: "hexahedra", dmesh.CellType.tetrahedron: "tetrahedra"}
_kept: list[Any] = []


def _references(items: list[Any], k: int) -> int:
    return sys.getrefcount(items[k])


ALONE = _references([object()], 0)  # of what only a list refers to, however Python counts


def keep(mesh: Any) -> None:
    """Keep a mesh until all that is made on it has gone; drop others whose time has come."""
    let_go()
    # The object of C++, which function spaces and forms refer to as well.
    if not any(mesh._cpp_object is other for other in _kept):
        _kept.append(mesh._cpp_object)


def kept() -> int:
    """Number of meshes that are kept."""
    return len(_kept)


def let_go() -> None:
    """Drop the meshes that nothing else refers to."""
    k = 0
    while k < len(_kept):
        if _references(_kept, k) <= ALONE:
            del _kept[k]
        else:
            k += 1


atexit.register(_kept.clear)


@dataclass(frozen=True)
class EntitySet:
    """Mesh entities that go by one name.

    Attributes:
        name: Physical name.
        dim: Dimension: 3 cells, 2 facets, 1 edges, 0 vertices.
        entities: Sorted local indices on this rank, ghosts included.
    """

    name: str
    dim: int
    entities: Indices

    def __post_init__(self) -> None:
        take_fields(self)


@dataclass(frozen=True)
class Domain:
    """A 3D mesh of hexahedra or tetrahedra with named sets of its entities.

    Attributes:
        mesh: The DOLFINx mesh; coordinates in metres.
        sets: Named sets by (name, dimension).
    """

    mesh: dmesh.Mesh
    sets: Mapping[tuple[str, int], EntitySet]

    def __init__(self, mesh: dmesh.Mesh, sets: Sequence[EntitySet] = ()) -> None:
        """Check the mesh and take the sets over. Collective.

        Args:
            mesh: A 3D mesh in three-dimensional space.
            sets: Named sets.

        Raises:
            SceneError: If the mesh is none, is not 3D, has cells of an unsupported kind, inverted
                cells or cells without volume, or the sets are none.
        """
        if not isinstance(mesh, dmesh.Mesh):
            raise SceneError(
                f"Domain: mesh must be a mesh of DOLFINx, got {shown(mesh)}. Files are read by "
                "read_msh, read_geo and read_cad."
            )
        listed = isinstance(sets, Sequence) and all(isinstance(s, EntitySet) for s in sets)
        if not listed:
            raise SceneError(
                f"Domain: sets must be a list of EntitySet, got {shown(sets)}. Sets are named by "
                "with_cells, with_facets, with_edges and with_vertices."
            )
        tdim, gdim = mesh.topology.dim, mesh.geometry.dim
        if (tdim, gdim) != (3, 3):
            raise SceneError(
                f"rigidfx needs a three-dimensional mesh, got cells of dimension {tdim} in a space "
                f"of dimension {gdim}. Check that the file holds volume cells (a 3D physical "
                "group), not only surfaces."
            )
        if mesh.topology.cell_type not in CELLS:
            raise SceneError(
                f"rigidfx knows hexahedra and tetrahedra, got {mesh.topology.cell_type}. Wedges "
                "become hexahedra if the triangles they stand on are recombined to quadrilaterals."
            )
        keep(mesh)
        check_cells(mesh)
        object.__setattr__(self, "mesh", mesh)
        object.__setattr__(self, "sets", MappingProxyType({(s.name, s.dim): s for s in sets}))

    def __del__(self) -> None:
        """Let the mesh go where no exception is under way: see above."""
        vars(self).pop("mesh", None)
        let_go()

    def __repr__(self) -> str:
        """Size and names, in a line."""
        cells, kind = self.mesh.topology.index_map(3).size_global, self.mesh.topology.cell_type
        return f"<Domain: {cells} {CELLS[kind]}; names: {self.names}>"

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the mesh."""
        return self.mesh.comm

    @property
    def names(self) -> str:
        """The known names, for messages."""
        known = sorted(self.sets, key=lambda key: (-key[1], key[0]))
        return ", ".join(f"'{name}' ({KINDS[dim]})" for name, dim in known) or "none"

    def find(self, name: str, dims: Sequence[int], wanted_by: str) -> EntitySet:
        """The set of a name. Collective.

        Args:
            name: Physical name.
            dims: Admissible dimensions; if the name has several, the first one here wins.
            wanted_by: Who asks, for the message.

        Raises:
            SceneError: If the name is unknown, of another dimension, or the set is empty.
        """
        found = [self.sets[name, dim] for dim in dims if (name, dim) in self.sets]
        if not found:
            wanted = " or ".join(KINDS[dim] for dim in dims)
            raise SceneError(
                f"{wanted_by}: there are no {wanted} named '{name}'. Known names: {self.names}."
            )
        if self.count(found[0]) == 0:
            raise SceneError(
                f"{wanted_by}: the name '{name}' stands for no {KINDS[found[0].dim]} at all. "
                f"Check the tag or the marker function behind it. Known names: {self.names}."
            )
        return found[0]

    def count(self, entities: EntitySet) -> int:
        """Number of entities of a set over all ranks, each counted once. Collective."""
        self.mesh.topology.create_entities(entities.dim)
        owned = self.mesh.topology.index_map(entities.dim).size_local
        return self.comm.allreduce(int(np.count_nonzero(entities.entities < owned)))

    def _with(
        self,
        name: str,
        dim: int,
        marker: Marker,
        locate: Callable[..., Any] = dmesh.locate_entities,
        of: str = "",
    ) -> Domain:
        _check_name(name)
        tdim = self.mesh.topology.dim
        self.mesh.topology.create_entities(dim)
        self.mesh.topology.create_connectivity(dim, tdim)

        def checked(x: Array) -> Bools:
            found = np.asarray(marker(x))
            if found.dtype != np.bool_ or found.shape != x.shape[1:]:
                raise SceneError(
                    f"The marker of '{name}' must give a boolean for each point, shape "
                    f"{x.shape[1:]}; it gives {found.dtype}, shape {found.shape}."
                )
            return found

        entities = together(
            self.comm, f"The marker of '{name}'", lambda: locate(self.mesh, dim, checked)
        )
        new = EntitySet(name, dim, np.sort(entities).astype(np.int32))
        out = replace_sets(self, {**self.sets, (name, dim): new})
        if out.count(new) == 0 and of:
            raise SceneError(
                f"The marker of '{name}' is true for no facet at the boundary of the cells '{of}'."
            )
        if out.count(new) == 0:
            inner = dmesh.locate_entities(self.mesh, dim, checked)
            count = self.count(EntitySet(name, dim, np.sort(inner).astype(np.int32)))
            given = f"The marker of '{name}' is true for"
            if count == 0:
                raise SceneError(f"{given} no {KINDS[dim]} of the mesh.")
            if dim == 1:
                raise SceneError(
                    f"{given} both ends of {count} edges and for the middle of none, which "
                    f"with_edges asks for, too.{CHORDS}"
                )
            raise SceneError(
                f"{given} {count} facets inside the mesh and for none of its boundary, which "
                "with_facets names. Of the nodes inside, with_vertices makes a set for supports."
            )
        return out

    def with_cells(self, name: str, marker: Marker) -> Domain:
        """A domain with a new set of cells: those with all vertices in the marker. Collective.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).

        Raises:
            SceneError: If no cell fulfils it.
        """
        return self._with(name, 3, marker)

    def with_facets(self, name: str, marker: Marker, *, of: str | None = None) -> Domain:
        """A domain with a new set of facets: boundary facets in the marker. Collective.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).
            of: Name of the cells that they bound; of all cells if None. It tells the faces of two
                parts apart that touch, and share no nodes.

        Raises:
            SceneError: If no facet fulfils it, or no cells have the name.
        """
        if of is None:
            return self._with(name, 2, marker, dmesh.locate_entities_boundary)
        owner = f"with_facets ('{name}')"
        if not isinstance(of, str):
            raise SceneError(f"{owner}: of must be the name of cells, got {shown(of)}.")
        cells = self.find(of, (3,), owner).entities

        def bounding(mesh: dmesh.Mesh, dim: int, marker: Marker) -> Indices:
            facets = dmesh.locate_entities_boundary(mesh, dim, marker)
            own = dmesh.compute_incident_entities(mesh.topology, cells, 3, 2)
            return np.intersect1d(facets, own)

        self.mesh.topology.create_connectivity(3, 2)
        return self._with(name, 2, marker, bounding, of)

    def with_edges(self, name: str, marker: Marker) -> Domain:
        """A domain with a new set of edges: ends and middle in the marker. Collective.

        Cells of second order have a node in the middle of each edge. A warning tells of vertices in
        the marker at which no edge of the set ends.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).

        Raises:
            SceneError: If no edge fulfils it.
        """
        out = self._with(name, 1, marker, edges_within)
        vertices = dmesh.locate_entities(self.mesh, 0, marker)
        if loose := count_loose(self.mesh, vertices, out.sets[name, 1].entities):
            warn(
                self.comm,
                f"The marker of '{name}' is true for {loose} vertices at which no edge of the set "
                f"ends, and which are left out. An edge needs its middle in the marker.{CHORDS}",
            )
        return out

    def with_vertices(self, name: str, marker: Marker) -> Domain:
        """A domain with a new set of vertices: those in the marker. Collective.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).

        Raises:
            SceneError: If no vertex fulfils it.
        """
        return self._with(name, 0, marker)

    def with_cell_set(self, name: str, cells: npt.ArrayLike) -> Domain:
        """A domain with a new set of the given local cells, ghosts included. Collective.

        Args:
            name: New name.
            cells: Local cell indices.

        Raises:
            SceneError: If they are no whole numbers, such as a boolean mask, one is outside the
                mesh, or there are no cells at all.
        """
        _check_name(name)
        given = np.asarray(cells)
        hidden = bool(np.ma.is_masked(cells))
        whole = given.size == 0 or (given.ndim == 1 and given.dtype.kind in "iu")
        masked = " Of a mask, take np.flatnonzero." if given.dtype == np.bool_ else ""
        masked = " Some are masked; take compressed()." if hidden else masked
        agree(
            self.comm,
            None
            if whole and not hidden
            else f"Cell set '{name}': cells must be a list of whole numbers, got {given.dtype} of "
            f"shape {given.shape}.{masked}",
        )
        cells = np.unique(given.astype(np.int64))
        map_ = self.mesh.topology.index_map(3)
        bad = cells[(cells < 0) | (cells >= map_.size_local + map_.num_ghosts)]
        agree(self.comm, f"Cell set '{name}': no cell {bad[0]} on this rank." if bad.size else None)
        new = EntitySet(name, 3, cells.astype(np.int32))
        out = replace_sets(self, {**self.sets, (name, 3): new})
        if out.count(new) == 0:
            raise SceneError(f"Cell set '{name}' is empty.")
        return out


def _check_name(name: object) -> None:
    """Refuse anything that cannot be the name of a set."""
    if not isinstance(name, str) or not name or not name.isprintable():
        raise SceneError(
            f"The name of a set must be a text that is not empty, and can be printed, "
            f"got {shown(name)}."
        )


def replace_sets(domain: Domain, sets: Mapping[tuple[str, int], EntitySet]) -> Domain:
    """The same mesh, already checked, with other sets."""
    new = object.__new__(Domain)
    object.__setattr__(new, "mesh", domain.mesh)
    object.__setattr__(new, "sets", MappingProxyType(dict(sets)))
    return new


def box_of(comm: MPI.Intracomm, x: Array) -> tuple[Array, Array]:
    """Ends of the box of some places of all ranks, shapes (3,) [m]. Collective."""
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return low, high


def nodes_of(mesh: dmesh.Mesh, dim: int, entities: Indices) -> Indices:
    """Nodes of the geometry in the closure of entities, corners first, by rows. Collective."""
    mesh.topology.create_entities(dim)
    for one, other in ((dim, 3), (3, dim)):
        mesh.topology.create_connectivity(one, other)
    if not entities.size:  # which DOLFINx divides by
        layout = compat.coordinate_map(mesh).create_dof_layout()
        return np.empty((0, len(layout.entity_closure_dofs(dim, 0))), np.int32)
    return np.asarray(dmesh.entities_to_geometry(mesh, dim, entities))


def by_corners(mesh: dmesh.Mesh, dim: int, named: Mapping[str, Ints]) -> dict[str, Indices]:
    """Local entities with given corners, ghosts included, by name. Collective.

    Corners, of shape (entities, corners), have their numbers in the input, in any order, the same
    on all ranks. Those of no entity are left out.
    """
    if not named:
        return {}
    mesh.topology.create_entities(dim)
    known = mesh.topology.index_map(dim)
    every = np.arange(known.size_local + known.num_ghosts, dtype=np.int32)
    numbers = np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)
    nodes = numbers[nodes_of(mesh, dim, every)]
    found = {}
    for name, corners in named.items():
        own = np.sort(nodes[:, : corners.shape[1]], axis=1)
        likely = np.flatnonzero(np.isin(own, corners).all(axis=1))  # few as a rule
        both = np.concatenate([np.sort(corners, axis=1), own[likely]])
        _, which = np.unique(both, axis=0, return_inverse=True)
        wanted, which = np.split(which.reshape(-1), [len(corners)])
        found[name] = every[likely[np.isin(which, wanted)]]
    return found


def edges_within(mesh: dmesh.Mesh, dim: int, marker: Callable[[Any], Any]) -> Indices:
    """Local edges with both ends and the middle in a marker, ghosts included; `dim` is 1.

    An edge across a corner has both ends on the rim of a face, and its middle inside.
    """
    edges = dmesh.locate_entities(mesh, dim, marker)
    nodes = nodes_of(mesh, dim, edges)  # both ends, then the middle of a curved one
    middles = mesh.geometry.x[nodes[:, 2:] if nodes.shape[1] > 2 else nodes].mean(axis=1)
    return np.asarray(edges[marker(middles.T)])


def count_loose(mesh: dmesh.Mesh, vertices: Indices, edges: Indices) -> int:
    """Number of vertices at which none of the edges ends. Collective."""
    mesh.topology.create_connectivity(1, 0)
    marks = la.vector(mesh.topology.index_map(0), 1, dtype=np.float64)
    marks.array[dmesh.compute_incident_entities(mesh.topology, edges, 1, 0)] = 1.0
    marks.scatter_reverse(la.InsertMode.add)
    own = vertices[vertices < mesh.topology.index_map(0).size_local]
    return int(mesh.comm.allreduce(int(np.count_nonzero(marks.array[own] == 0.0))))


def count_between(mesh: dmesh.Mesh, vertices: Indices) -> int:
    """Number of edges with both ends among some vertices. Collective."""
    mesh.topology.create_entities(1)
    mesh.topology.create_connectivity(1, 0)
    owned = mesh.topology.index_map(1).size_local
    ends = mesh.topology.connectivity(1, 0).array[: 2 * owned].reshape(-1, 2)
    return int(mesh.comm.allreduce(int(np.count_nonzero(np.isin(ends, vertices).all(axis=1)))))

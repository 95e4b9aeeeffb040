"""A mesh with its named parts; boxes and arrays for quick scenes.

Everything a scene refers to is found by *name*: a name stands for a set of cells, facets, edges or
vertices. A domain never changes; `with_cells`, `with_facets` and `with_vertices` return a new one
that knows one name more.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import basix.ufl
import dolfinx.mesh as dmesh
import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI

from rigidfx.base import compat
from rigidfx.base.errors import SceneError, agree, together
from rigidfx.base.inputs import numbers
from rigidfx.domain.cell_quality import check_cells

__all__ = ["Domain", "EntitySet", "box", "from_arrays"]

Marker = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]]

KINDS = {3: "cells", 2: "facets", 1: "edges", 0: "vertices"}
CELLS = {dmesh.CellType.hexahedron: "hexahedra", dmesh.CellType.tetrahedron: "tetrahedra"}


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
    entities: npt.NDArray[np.int32]


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
            SceneError: If the mesh is not 3D, has cells of an unsupported kind, inverted cells or
                cells without volume.
        """
        tdim, gdim = mesh.topology.dim, mesh.geometry.dim
        if (tdim, gdim) != (3, 3):
            raise SceneError(
                f"rigidfx needs a three-dimensional mesh, got cells of dimension {tdim} in a space "
                f"of dimension {gdim}. Check that the file holds volume cells (a 3D physical "
                "group), not only surfaces."
            )
        if mesh.topology.cell_type not in CELLS:
            raise SceneError(
                f"rigidfx knows hexahedra and tetrahedra, got {mesh.topology.cell_type}."
            )
        check_cells(mesh)
        object.__setattr__(self, "mesh", mesh)
        object.__setattr__(self, "sets", MappingProxyType({(s.name, s.dim): s for s in sets}))

    def __del__(self) -> None:
        """Let the mesh go where no exception is under way.

        `Scene(box(...), material, [Rigid(3)])` drops the box while its error is on the way, and
        mpi4py, as the mesh's communicator goes, would take that error for its own and keep a lock
        (4.0): the process would never end. In a finalizer Python sets exceptions aside.
        """
        vars(self).pop("mesh", None)

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
            dims: Dimensions that will do; if the name has several, the first one here wins.
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
        owned = self.mesh.topology.index_map(entities.dim).size_local
        return self.comm.allreduce(int(np.count_nonzero(entities.entities < owned)))

    def _with(self, name: str, dim: int, marker: Marker, boundary: bool) -> Domain:
        _check_name(name)
        tdim = self.mesh.topology.dim
        self.mesh.topology.create_entities(dim)
        self.mesh.topology.create_connectivity(dim, tdim)
        locate = dmesh.locate_entities_boundary if boundary else dmesh.locate_entities

        def checked(x: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
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
        if out.count(new) == 0:
            raise SceneError(f"The marker of '{name}' is true for no {KINDS[dim]} of the mesh.")
        return out

    def with_cells(self, name: str, marker: Marker) -> Domain:
        """A domain that also knows the cells all of whose vertices fulfil a marker. Collective.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).

        Raises:
            SceneError: If no cell fulfils it.
        """
        return self._with(name, 3, marker, boundary=False)

    def with_facets(self, name: str, marker: Marker) -> Domain:
        """A domain that also knows boundary facets whose vertices fulfil a marker. Collective.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).

        Raises:
            SceneError: If no facet fulfils it.
        """
        return self._with(name, 2, marker, boundary=True)

    def with_vertices(self, name: str, marker: Marker) -> Domain:
        """A domain that also knows the vertices that fulfil a marker. Collective.

        Args:
            name: New name.
            marker: Function of x, shape (3, n) [m], to booleans of shape (n,).

        Raises:
            SceneError: If no vertex fulfils it.
        """
        return self._with(name, 0, marker, boundary=False)

    def with_cell_set(self, name: str, cells: npt.ArrayLike) -> Domain:
        """A domain that also knows the given local cells (ghosts included). Collective.

        Args:
            name: New name.
            cells: Local cell indices.

        Raises:
            SceneError: If they are no whole numbers, such as a boolean mask, one is outside the
                mesh, or there are no cells at all.
        """
        _check_name(name)
        given = np.asarray(cells)
        whole = given.size == 0 or (given.ndim == 1 and given.dtype.kind in "iu")
        masked = " Of a mask, take np.flatnonzero." if given.dtype == np.bool_ else ""
        agree(
            self.comm,
            None
            if whole
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
    """Refuse what cannot be the name of a set."""
    if not isinstance(name, str) or not name:
        raise SceneError(f"The name of a set must be a text that is not empty, got {name!r}.")


def replace_sets(domain: Domain, sets: Mapping[tuple[str, int], EntitySet]) -> Domain:
    """The same mesh, already checked, with other sets."""
    new = object.__new__(Domain)
    object.__setattr__(new, "mesh", domain.mesh)
    object.__setattr__(new, "sets", MappingProxyType(dict(sets)))
    return new


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
        SceneError: If the box has no volume, a number of cells is below one or the cell is unknown.
    """
    try:
        a, b = (numbers(corner) for corner in (lower, upper))
        counts = [operator.index(n) for n in cells]
    except (TypeError, ValueError):
        raise SceneError(
            "box: lower and upper must be three numbers each and cells three whole numbers, got "
            f"{lower!r}, {upper!r}, {cells!r}."
        ) from None
    finite = a.shape == b.shape == (3,) and bool(np.isfinite([a, b]).all())
    if not finite or not np.all(b > a):
        raise SceneError(
            "box: lower and upper must be three finite numbers each, and upper must exceed lower "
            f"in all of x, y, z; got {lower}, {upper}."
        )
    if len(counts) != 3 or min(counts) < 1:
        raise SceneError(f"box: cells must be three whole numbers ≥ 1, got {cells}.")
    kinds = {kind.name: kind for kind in CELLS}
    if not isinstance(cell, str) or cell not in kinds:
        raise SceneError(f"box: cell must be one of {sorted(kinds)}, got {cell!r}.")
    mesh = dmesh.create_box(
        comm, [a, b], counts, kinds[cell], ghost_mode=dmesh.GhostMode.shared_facet
    )
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
        cells: Corner numbers in DOLFINx's order (of a hexahedron: x fastest, then y, then z),
            shape (cells, 8) or (cells, 4); empty on all ranks but one.
        cell: "hexahedron" or "tetrahedron".
        comm: Communicator of the mesh.

    Raises:
        SceneError: If shapes, kinds or numbers do not fit, a cell is there twice, or cells are
            inverted or flat.
    """
    corners = {"hexahedron": 8, "tetrahedron": 4}
    if not isinstance(cell, str) or cell not in corners:
        raise SceneError(f"from_arrays: cell must be one of {sorted(corners)}, got {cell!r}.")
    agree(comm, _misfit(points, cells, corners[cell]))
    x = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    rows = np.asarray(cells).astype(np.int64).reshape(-1, corners[cell])
    some = comm.allreduce(len(rows)) > 0
    agree(comm, None if some else "from_arrays: there are no cells.")
    element = basix.ufl.element("Lagrange", cell, 1, shape=(3,))
    return Domain(compat.create_mesh(comm, rows, x, ufl.Mesh(element)))


def _misfit(points: npt.ArrayLike, cells: npt.ArrayLike, corners: int) -> str | None:
    """What is wrong with the arrays of this rank, None if nothing."""
    try:
        x, rows = np.asarray(points), np.asarray(cells)
    except ValueError:
        return "from_arrays: points and cells must be arrays; some of their rows differ in length."
    for name, given, kinds, width in (("points", x, "iuf", 3), ("cells", rows, "iu", corners)):
        kind = "whole numbers" if kinds == "iu" else "real numbers"
        if given.size and (given.dtype.kind not in kinds or given.shape[1:] != (width,)):
            return (
                f"from_arrays: {name} must be {kind} of shape (n, {width}), got {given.dtype} of "
                f"shape {given.shape}."
            )
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
    return None


def _on_plane(axis: int, value: float, tol: float) -> Marker:
    return lambda x: np.abs(x[axis] - value) < tol

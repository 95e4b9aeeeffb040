"""Cells dealt out among the ranks anew: copies on a mesh of their own, where forms are assembled.

A mesh is divided among ranks by all of its cells. Where most of them are rigid, those that are left
may be one rank's. Copies of these are a mesh of their own, divided equally: the same compiled forms
are bound to it, and coefficients have copies there, too, cell by cell. All else stays where it is.
"""

from collections.abc import Sequence
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base import compat
from rigidfx.base.types import Array, Indices, Ints

Int = PETSc.IntType


class Exchange:
    """Ways from items of all ranks to copies of them on any rank; `destroy` frees it."""

    def __init__(self, comm: MPI.Intracomm, items: int, rank: Any, place: Any) -> None:
        """Find the ways from items of ranks, by their places, to copies on this one. Collective."""
        self._items, self._copies = items, len(rank)
        self._graph = PETSc.SF().create(comm)
        ways = np.stack([rank, place], axis=1).astype(Int)
        self._graph.setGraph(items, None, ways.reshape(-1))
        self._graph.setUp()
        # PETSc adds up its own numbers, and several together, but not a type of one of them.
        self._units: dict[int, MPI.Datatype] = {1: MPI.DOUBLE}

    def give(self, values: Array) -> Array:
        """Values of the items, shape (items, k), at their copies, (copies, k). Collective."""
        given, out = np.ascontiguousarray(values), np.empty((self._copies, values.shape[1]))
        passed = self._unit(values.shape[1]), given, out, MPI.REPLACE
        self._graph.bcastBegin(*passed)
        self._graph.bcastEnd(*passed)
        return out

    def collect(self, values: Array) -> Array:
        """Sums of copies' values, shape (copies, k), for their items, (items, k). Collective."""
        given, out = np.ascontiguousarray(values), np.zeros((self._items, values.shape[1]))
        passed = self._unit(values.shape[1]), given, out, MPI.SUM
        self._graph.reduceBegin(*passed)
        self._graph.reduceEnd(*passed)
        return out

    def _unit(self, numbers: int) -> MPI.Datatype:
        """So many numbers, as MPI sends them."""
        if numbers not in self._units:
            self._units[numbers] = MPI.DOUBLE.Create_contiguous(numbers).Commit()
        return self._units[numbers]

    def destroy(self) -> None:
        """Free the ways. Collective."""
        self._graph.destroy()
        for numbers in [numbers for numbers in self._units if numbers > 1]:
            self._units.pop(numbers).Free()


NOWHERE = -1


class DealtCells:
    """Copies of some cells, divided equally among the ranks; `destroy` frees them.

    Attributes:
        space: Function space of the displacement on their mesh.
        mesh: Their mesh.
    """

    def __init__(self, space: Any, cells: Indices) -> None:
        """Deal owned cells out, sorted. Collective."""
        mesh = space.mesh
        self._original, self._cells = space, cells
        known = mesh.geometry.index_map()
        nodes = compat.cell_geometry_dofs(mesh)[cells]
        corners = known.local_to_global(nodes.reshape(-1)).reshape(nodes.shape).astype(np.int64)
        element = ufl.Mesh(mesh.ufl_domain().ufl_coordinate_element())
        points = mesh.geometry.x[: known.size_local]
        shares = compat.partitioner_without_ghosts()
        self.mesh = compat.create_mesh(mesh.comm, corners, points, element, shares)
        self.space = fem.functionspace(self.mesh, space.ufl_element())
        firsts = np.cumsum([0, *mesh.comm.allgather(cells.size)])
        place = self.mesh.topology.original_cell_index
        rank = np.searchsorted(firsts, place, side="right") - 1
        self._exchange = Exchange(mesh.comm, cells.size, rank, place - firsts[rank])
        self._copies: dict[fem.Function, fem.Function] = {}
        self._spaces = {space.ufl_element(): self.space}

    def hold(self, cells: Indices) -> bool:
        """Whether owned cells of the original mesh are among them, on all ranks. Collective."""
        here = bool(np.isin(cells, self._cells).all())
        return bool(self.mesh.comm.allreduce(here, op=MPI.LAND))

    def counts(self, own: Indices) -> Ints:
        """How many copies each rank has of some owned cells. Collective."""
        return np.array(self.mesh.comm.allgather(self.cells(own).size))

    def forget(self) -> None:
        """Let coefficients go that have copies: other forms read others."""
        self._copies.clear()

    def cells(self, own: Indices) -> Indices:
        """Copies on this rank of some owned cells. Collective."""
        wanted = np.isin(self._cells, own).astype(np.float64)
        return np.flatnonzero(self._exchange.give(wanted[:, None])[:, 0]).astype(np.int32)

    def facets(self, pairs: Indices) -> Indices:
        """Cells and local numbers of copies of facets, given as such, (n, 2). Collective."""
        kind = getattr(basix.CellType, self.mesh.topology.cell_type.name)
        marks = np.zeros((self._cells.size, len(basix.topology(kind)[2])))
        marks[np.searchsorted(self._cells, pairs[:, 0]), pairs[:, 1]] = 1.0
        return np.argwhere(self._exchange.give(marks)).astype(np.int32)

    def copy(self, function: fem.Function) -> fem.Function:
        """The copy of a coefficient, which `refresh` keeps up to date. Collective if it is new."""
        if function not in self._copies:
            element = function.function_space.ufl_element()
            if element not in self._spaces:
                self._spaces[element] = fem.functionspace(self.mesh, element)
            self._copies[function] = fem.Function(self._spaces[element])
            self._copy(function)
        return self._copies[function]

    def refresh(self, known: Sequence[fem.Function]) -> None:
        """Update copies to the values of the coefficients, but for known ones. Collective."""
        for function in self._copies:
            if not any(function is other for other in known):
                self._copy(function)

    def _copy(self, function: fem.Function) -> None:
        to, of = self._copies[function], function.function_space.dofmap
        block = of.index_map_bs
        values = function.x.array.reshape(-1, block)[of.list[self._cells]]
        there = to.function_space.dofmap.list
        given = self._exchange.give(values.reshape(len(values), there.shape[1] * block))
        to.x.array.reshape(-1, block)[there.reshape(-1)] = given.reshape(-1, block)

    def at_nodes(self, values: Array) -> Array:
        """Values of local nodes, at their copies, ghosts included. Collective."""
        of, there = self._original.dofmap.list, self.space.dofmap.list
        k = values.shape[1]
        of_cells = values[of[self._cells]].reshape(self._cells.size, of.shape[1] * k)
        given = self._exchange.give(of_cells)
        nodes = self.space.dofmap.index_map
        out = np.full((nodes.size_local + nodes.num_ghosts, k), float(NOWHERE))
        out[there.reshape(-1)] = given.reshape(-1, k)
        return out

    def destroy(self) -> None:
        """Free the ways between ranks. Collective."""
        self._exchange.destroy()

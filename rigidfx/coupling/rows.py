"""Vectors and matrices over some of the nodes only: a step pays for no others.

PETSc's objects of a step have three rows for each node that takes part in it. DOLFINx's functions
and forms know all nodes; values pass between the two by index, element matrices by PETSc's
local-to-global map, which drops unwanted entries.

PETSc finds a pattern by itself in the first assembly, entry by entry in a hash table: at 2·10⁵
unknowns that took 16 s, four times a step. DOLFINx finds in 0.1 s which nodes share a cell.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.compat import known_columns
from rigidfx.base.types import Array, Bools, Indices, Ints

Int = PETSc.IntType
# Entries of each of this rank's rows in columns of this rank's, and in others.
Lengths = tuple[npt.NDArray[Any], npt.NDArray[Any]]


class Rows:
    """The rows of a set of nodes, three each.

    Attributes:
        nodes: Owned nodes, sorted.
        dofs: Their owned dofs, in the order of the rows.
        X: Their reference positions, shape (nodes, 3) [m].
        first: Number of this rank's first row.
    """

    def __init__(self, space: Any, nodes: Indices) -> None:
        """Number the rows of owned, sorted nodes of a space. Collective."""
        self._space, self.comm = space, space.mesh.comm
        self.nodes = nodes
        self.dofs = (3 * nodes.astype(np.int64)[:, None] + np.arange(3)).reshape(-1)
        self.X = space.tabulate_dof_coordinates()[nodes]
        self.first: int = self.comm.exscan(self.dofs.size) or 0

    def vector(self) -> PETSc.Vec:
        """A new vector; the caller destroys it."""
        out = PETSc.Vec().create(self.comm)
        out.setSizes((self.dofs.size, None))
        out.setType(PETSc.Vec.Type.STANDARD)
        return out

    def matrix(self, form: fem.Form) -> PETSc.Mat:
        """A new matrix without entries, and room for those of a form. Collective."""
        lengths, kind = row_lengths(form, self.nodes), PETSc.Mat.Type.AIJ
        numbers = self.first + np.arange(self.dofs.size)
        return mapped_matrix(self._space, self.dofs, numbers, lengths, kind, 3)

    def assembled(self, form: fem.Form) -> PETSc.Mat:
        """A form's matrix; the caller destroys it. Collective."""
        A = self.matrix(form)
        fem_petsc.assemble_matrix(A, form)
        A.assemble()
        return A

    def add_blocks(self, A: PETSc.Mat, blocks: Array) -> None:
        """Add blocks, (nodes, 3, 3), to nodes' entries of a matrix, and assemble it. Collective."""
        at = np.flatnonzero(blocks.any(axis=(1, 2)))
        numbers = (self.first + 3 * at[:, None] + np.arange(3)).astype(Int)
        offsets = np.arange(0, 3 * numbers.size + 1, 3, dtype=Int)
        columns, values = np.repeat(numbers, 3, axis=0).reshape(-1), blocks[at].reshape(-1)
        A.setValuesIJV(offsets, columns, values, PETSc.InsertMode.ADD_VALUES, numbers.reshape(-1))
        A.assemble()

    def positions(self, nodes: Indices) -> Ints:
        """Places of some of the nodes among them."""
        return np.searchsorted(self.nodes, nodes)


def mapped_matrix(
    space: Any, dofs: Ints, numbers: Ints, lengths: Lengths, kind: str, block: int
) -> PETSc.Mat:
    """A square matrix without entries that maps local nodes (or dofs) to rows. Collective.

    Owned dofs have a row by its number; entries of all others are dropped. Rows, or rows of blocks
    of 3, have lengths: longer ones cost time, no more.
    """
    every = fem.Function(space)
    every.x.array[:] = -1.0
    every.x.array[dofs] = numbers
    every.x.scatter_forward()
    local = every.x.array[::block].astype(np.int64)
    comm = space.mesh.comm
    mapping = PETSc.LGMap().create(
        np.where(local >= 0, local // block, -1).astype(Int), bsize=block, comm=comm
    )
    A = PETSc.Mat().create(comm)
    blocked = block if kind == PETSc.Mat.Type.BAIJ else 1
    A.setSizes([(blocked * lengths[0].size, None)] * 2)
    A.setType(kind)
    A.setBlockSize(block)
    A.setLGMap(mapping, mapping)
    A.setPreallocationNNZ(lengths)
    A.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
    mapping.destroy()
    return A


def product(multiply: Callable[..., PETSc.Mat | None], u: Array, comm: Any) -> Array:
    """A product with all columns u of this rank, (rows, k), by one call. Collective."""
    if not u.shape[1]:
        return u.copy()
    B, X = (PETSc.Mat().createDense([(len(u), None), (None, u.shape[1])], comm=comm) for _ in "BX")
    for dense in (B, X):
        dense.setUp()
    B.getDenseArray()[:] = u
    for dense in (B, X):
        dense.assemble()
    multiply(B, X)
    out = np.array(X.getDenseArray())
    B.destroy()
    X.destroy()
    return out


def couplings(form: fem.Form) -> tuple[csr_array, Any]:
    """Ones where an owned and a known node share a cell, and the map of the known ones."""
    found = fem.create_sparsity_pattern(form)
    found.finalize()
    columns, offsets = found.graph
    known = known_columns(found)
    shape = found.index_map(0).size_local, known.size_local + known.num_ghosts
    offsets = offsets[: shape[0] + 1]
    columns = columns[: offsets[-1]]
    return csr_array((np.ones(columns.size), columns, offsets), shape=shape), known


def row_lengths(form: fem.Form, nodes: Indices) -> Lengths:
    """Of a matrix of a bilinear form with three rows for each of some owned nodes. Collective."""
    pattern, known = couplings(form)
    has_rows = la.vector(known)
    has_rows.array[nodes] = 1.0
    has_rows.scatter_forward()
    own = np.arange(has_rows.array.size) < pattern.shape[0]
    lengths = (pattern @ parted(3 * has_rows.array, own))[nodes]
    inside, outside = np.repeat(lengths, 3, axis=0).astype(PETSc.IntType).T
    return inside, outside


def parted(columns: Any, inside: Bools) -> Array:
    """Numbers of columns inside a rank's own, and of those outside, shape (n, 2)."""
    return np.stack([columns * inside, columns * ~inside], axis=1).astype(np.float64)

"""The reduced tangent, assembled from flexible cells in the solver's own format.

Cells at the *interface* of rigid bodies are assembled into a matrix K of their own, that of each
rank's cells, which PETSc's MatPtAP condenses to Lᵀ K P = diag(1, L_b)ᵀ (Aᵀ K A) diag(1, P_b):
docs/theory.md, section 3. A is constant, with a unit column for each dof of nodes that no body
moves and 3 n columns for each body, n = 4 + 3 m. K enters it without its entries between two nodes
that no body moves, which go straight into the reduced matrix. L_b and P_b, see `Increments`, then
make columns of the 6 + m unknowns, in blocks of three kinds: a node's rows in a body's columns, a
body's in a node's and a body's in a body's.

*Interior* cells touch no body: their entries are only renumbered, those of prescribed dofs being
dropped, by PETSc's local-to-global map. Where free dofs come in whole nodes the reduced matrix is
blocked (BAIJ), in which assembly takes two thirds and a Krylov iteration three fifths of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from scipy.sparse import bsr_array, csr_array, eye_array, kron

from rigidfx.base.compat import assemble_unrolled
from rigidfx.base.matrices import distributed, free
from rigidfx.base.types import Array, Indices, Ints
from rigidfx.coupling.moved_nodes import MovedNodes, condensed_row_lengths, moved_nodes
from rigidfx.coupling.prolongation import Prolongation

SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
SUBSET = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
Int = PETSc.IntType

ALGORITHM = "matptap_via"  # option of PETSc


@dataclass(frozen=True)
class Kind:
    """The blocks of one kind."""

    left: bool  # whether rows are of bodies
    right: bool  # whether columns are
    row: Ints  # node or body of each block's rows
    column: Ints  # node or body of its columns
    # Where the values of each are in the product's, shape (blocks, 3 or 3 n, 3 or 3 n)
    places: Ints

    def condensed(self, values: Array, LT: Array, P: Array) -> Array:
        """The blocks of a product in unknowns, cut into 3×3 blocks, one after the other.

        Lᵀ has the shape (bodies, 3 k, 3 n), 3 k being 6 + m and what is missing to threes, and P
        the shape (bodies, 3 n, 3 k).
        """
        K = values[self.places]
        if self.right:
            K = K @ P[self.column]
        if self.left:
            K = LT[self.row] @ K
        n, rows, columns = K.shape
        return K.reshape(n, rows // 3, 3, columns // 3, 3).swapaxes(2, 3).reshape(-1)


class BlockPlaces:
    """Where 3×3 blocks go in a reduced matrix."""

    def __init__(self, row: Ints, column: Ints, nodal: bool) -> None:
        """Prepare the arguments of PETSc by unknowns of the rows and columns of blocks.

        Unknowns have the shape (blocks, 3); values of those below zero are dropped. The reduced
        matrix has blocks if free dofs come in whole nodes.
        """
        self._nodal = nodal
        if nodal:
            row, column = row[:, 0] // 3, column[:, 0] // 3
        else:
            row = np.repeat(row.reshape(-1), 3)
            column = np.repeat(column, 3, axis=0).reshape(-1)
        starts = np.flatnonzero(np.diff(row, prepend=-2))  # a row is told once in a run
        self._rows = row[starts].astype(Int)
        self._offsets = np.r_[starts, row.size].astype(Int)
        self._columns = column.astype(Int)

    def add(self, matrix: PETSc.Mat, values: Array) -> None:
        """Add the blocks' values, nine each, to a matrix, which is to be assembled then."""
        add = matrix.setValuesBlockedIJV if self._nodal else matrix.setValuesIJV
        add(self._offsets, self._columns, values, PETSc.InsertMode.ADD_VALUES, self._rows)


class ProductBlocks:
    """Where the values of a product go."""

    def __init__(
        self, C: PETSc.Mat, of_nodes: Ints, of_bodies: Ints, height: int, nodal: bool
    ) -> None:
        """Sort the blocks of the product C: rows and columns of the nodes, then of the bodies.

        Unknowns are -1 where there is none, of nodes of the shape (nodes, 3), of bodies of the
        shape (bodies, 6 + m); the height is n.
        """
        indptr, columns, values = C.getValuesCSR()
        places = csr_array((np.arange(values.size), columns, indptr), shape=C.size)
        pattern = places.tobsr((3, 3))
        sides = (False, True), (True, False), (True, True)
        self._kinds = [_kind(pattern, len(of_nodes), height, *side) for side in sides]
        self._missing = -of_bodies.shape[1] % 3
        whole = np.pad(of_bodies, ((0, 0), (0, self._missing)), constant_values=-1)
        unknowns = of_nodes[:, None], whole.reshape(len(whole), whole.shape[1] // 3, 3)
        numbers = zip(*(_unknowns(kind, unknowns) for kind in self._kinds), strict=True)
        row, column = (np.concatenate([n.reshape(-1, 3) for n in side]) for side in numbers)
        self._places = BlockPlaces(row, column, nodal)

    def insert_into(self, matrix: PETSc.Mat, C: PETSc.Mat, L: Array, P: Array) -> None:
        """Add diag(1, L)ᵀ C diag(1, P) to a reduced matrix, which is to be assembled then.

        L and P have the shape (bodies, 3 n, 6 + m).
        """
        if self._missing:
            L, P = (np.pad(side, ((0, 0), (0, 0), (0, self._missing))) for side in (L, P))
        values, LT = C.getValuesCSR()[2], L.swapaxes(1, 2)
        blocks = [kind.condensed(values, LT, P) for kind in self._kinds]
        self._places.add(matrix, np.concatenate(blocks))


def _kind(pattern: bsr_array, nodes: int, n: int, left: bool, right: bool) -> Kind:
    """Join 3×3 blocks to those of one kind; the first rows and columns are of so many nodes."""
    row = np.repeat(np.arange(pattern.indptr.size - 1), np.diff(pattern.indptr))
    column = pattern.indices.astype(np.int64)
    mine = np.flatnonzero(((row >= nodes) == left) & ((column >= nodes) == right))
    height, width = n if left else 1, n if right else 1
    row, i = np.divmod(row[mine] - nodes * left, height)
    column, j = np.divmod(column[mine] - nodes * right, width)
    order = np.lexsort((j, i, column, row))
    places = pattern.data[mine[order]].reshape(-1, height, width, 3, 3).swapaxes(2, 3)
    first = order[:: height * width]
    shape = -1, 3 * height, 3 * width
    return Kind(left, right, row[first], column[first], places.reshape(shape))


def _unknowns(kind: Kind, unknowns: tuple[Ints, Ints]) -> tuple[Ints, ...]:
    """Unknowns of the rows and of the columns of each 3×3 block that `condensed` gives.

    Those of nodes have the shape (nodes, 1, 3), those of bodies (bodies, k, 3).
    """
    row, column = unknowns[kind.left][kind.row], unknowns[kind.right][kind.column]
    return tuple(np.broadcast_arrays(row[:, :, None], column[:, None]))


class Interface:
    """A bilinear form over the cells that touch bodies, condensed; `destroy` frees it."""

    def __init__(self, prolongation: Prolongation, form: fem.Form) -> None:
        """Fill A, find the pattern of the product, of cells that touch a body. Collective."""
        self._prolongation, self._form = prolongation, form
        self._assembled = fem.create_matrix(form)
        nodes = moved_nodes(prolongation, self._assembled.index_map(1))
        indptr, column = self._assembled.indptr, self._assembled.indices
        row = np.repeat(np.arange(indptr.size - 1), np.diff(indptr))
        alone = (nodes.body[row] < 0) & (nodes.body[column] < 0)
        self._alone, coupled = np.flatnonzero(alone), np.flatnonzero(~alone)
        numbers = nodes.unknowns[row[self._alone]], nodes.unknowns[column[self._alone]]
        self._places = BlockPlaces(*numbers, prolongation.nodal)
        here, rows, columns, self._coupled = _expanded(row[coupled], column[coupled], coupled)
        self._values = np.zeros(self._coupled.size)
        size, csr = 2 * (3 * here.size,), (rows, columns, self._values)
        self._K = PETSc.Mat().createAIJWithArrays(size, csr, comm=PETSc.COMM_SELF)
        nodes = nodes[here]
        self._bodies = np.unique(nodes.body[nodes.body >= 0])
        self._A = _master_slave(nodes, self._bodies)
        self._C = _product(self._K, self._A)
        of_nodes = nodes.unknowns[nodes.body < 0]
        of_bodies = prolongation.body_columns[self._bodies]
        height = nodes.coordinates.shape[1]
        self._blocks = ProductBlocks(self._C, of_nodes, of_bodies, height, prolongation.nodal)

    def assemble(self, other: fem.Form | None = None) -> None:
        """Assemble K anew, or that of another form over the same cells."""
        self._assembled.data[:] = 0.0
        fem.assemble_matrix(self._assembled, self._form if other is None else other)

    def add(self, other: Interface, factor: float) -> None:
        """Add a multiple of another K of the same cells."""
        self._assembled.data[:] += factor * other._assembled.data

    def insert_into(self, matrix: PETSc.Mat) -> None:
        """Add Lᵀ K P to a reduced matrix, which is to be assembled then."""
        values = self._assembled.data
        self._places.add(matrix, values.reshape(-1, 9)[self._alone])
        self._values[:] = values[self._coupled]
        self._K.stateIncrease()  # PETSc does not see that
        self._K.ptap(self._A, result=self._C)
        increments = self._prolongation.increments
        L, P = increments.L[self._bodies], increments.P[self._bodies]
        self._blocks.insert_into(matrix, self._C, L, P)

    def destroy(self) -> None:
        """Free the PETSc matrices."""
        free(self._C, self._A, self._K)


def _expanded(row: Ints, column: Ints, block: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """The scalar CSR matrix of 3×3 blocks, by numbers of nodes and blocks, sorted by rows.

    It has no rows of nodes that have none. The nodes, both index arrays, and where each value is
    among those of all blocks are returned.
    """
    nodes = np.union1d(row, column)
    places = 9 * block[:, None] + np.arange(9)
    indptr = np.searchsorted(row, np.r_[nodes, nodes.max(initial=0) + 1])
    csr = (places.reshape(-1, 3, 3), np.searchsorted(nodes, column), indptr)
    expanded = bsr_array(csr, shape=2 * (3 * nodes.size,)).tocsr()
    expanded.sort_indices()
    return nodes, expanded.indptr.astype(Int), expanded.indices.astype(Int), expanded.data


def _master_slave(nodes: MovedNodes, bodies: Ints) -> PETSc.Mat:
    """A, in each direction a for nodes of bodies and 1 for others."""
    others, slaves = np.flatnonzero(nodes.body < 0), np.flatnonzero(nodes.body >= 0)
    n = nodes.coordinates.shape[1]
    masters = others.size + n * np.searchsorted(bodies, nodes.body[slaves])
    rows = np.r_[others, np.repeat(slaves, n)]
    columns = np.r_[np.arange(others.size), np.add.outer(masters, np.arange(n)).reshape(-1)]
    values = np.r_[np.ones(others.size), nodes.coordinates[slaves].reshape(-1)]
    shape = nodes.body.size, others.size + n * bodies.size
    A = kron(csr_array((values, (rows, columns)), shape=shape), eye_array(3), format="csr")
    A.sort_indices()
    return distributed(A, A.shape, PETSc.COMM_SELF)


def _product(K: PETSc.Mat, A: PETSc.Mat) -> PETSc.Mat:
    """Aᵀ K A as a new matrix, by the user's algorithm if one is set, else by the fastest.

    For a body's face of 10×10 cells "rap" took 0.15 ms, PETSc's default 0.51 ms.
    """
    options = PETSc.Options()
    if options.hasName(ALGORITHM):
        return K.ptap(A)
    options[ALGORITHM] = "rap"
    try:
        return K.ptap(A)
    finally:
        options.delValue(ALGORITHM)


class CondensedMatrix:
    """A bilinear form over the flexible cells, condensed; `destroy` frees it.

    Attributes:
        matrix: The reduced matrix, of fixed pattern.
    """

    def __init__(self, prolongation: Prolongation, interior: fem.Form, interface: fem.Form) -> None:
        """Find the pattern of forms over interior cells and the interface. Collective."""
        self._prolongation, self._interior = prolongation, interior
        self._grown = False  # whether the pattern has more than the forms need
        own = sum(cells.size for cells in prolongation.layout.interior.values())
        self._has_interior = prolongation.comm.allreduce(own) > 0
        lengths = condensed_row_lengths(prolongation, interior, interface)
        self.matrix = prolongation.empty_matrix(lengths)
        self._insert(interior)
        self._interface = Interface(prolongation, interface) if prolongation.touched else None
        if self._interface is not None:
            self._interface.insert_into(self.matrix)
        bodies, columns = prolongation.no_bodies.shape
        prolongation.add_blocks(self.matrix, np.zeros((bodies, columns, columns)))
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)

    def assemble(self, other: tuple[fem.Form, fem.Form] | None = None) -> None:
        """Assemble the forms anew, or others over the same cells. Collective."""
        interior, interface = (self._interior, None) if other is None else other
        self.matrix.zeroEntries()
        self._insert(interior)
        if self._interface is not None:
            self._interface.assemble(interface)

    def add(self, other: CondensedMatrix, factor: float) -> None:
        """Add a multiple of another form of the same layout, before bodies are condensed."""
        self.matrix.assemble()
        self.matrix.axpy(factor, other.matrix, SUBSET if self._grown else SAME)
        if self._interface is not None and other._interface is not None:
            self._interface.add(other._interface, factor)

    def add_nodal(self, nodes: Indices, blocks: Array) -> None:
        """Add to the diagonal blocks of free, owned nodes, shape (nodes, 3, 3). Collective.

        Entries of prescribed dofs are dropped.
        """
        prolongation = self._prolongation
        offsets = np.arange(nodes.size + 1, dtype=PETSc.IntType)
        self.matrix.assemble()
        places = prolongation.layout.rows.positions(nodes)
        numbers = prolongation.numbers.reshape(-1, 3)[places].astype(PETSc.IntType)
        if prolongation.nodal:
            rows = np.where(numbers[:, 0] < 0, -1, numbers[:, 0] // 3).astype(PETSc.IntType)
            add = self.matrix.setValuesBlockedIJV
        else:
            rows = numbers.reshape(-1)
            offsets = 3 * np.arange(rows.size + 1, dtype=PETSc.IntType)
            add = self.matrix.setValuesIJV
        columns = rows if prolongation.nodal else np.repeat(rows.reshape(-1, 3), 3, axis=0)
        add(offsets, columns.reshape(-1), blocks.reshape(-1), PETSc.InsertMode.ADD_VALUES, rows)

    def add_coupling(self, entries: csr_array) -> None:
        """Add entries by any unknowns, equal on all ranks; the pattern grows. Collective."""
        self.matrix.assemble()
        if not self._grown:
            self._grown = True
            self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
            self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        first, last = self.matrix.getOwnershipRange()
        own = entries[first:last]
        rows = np.flatnonzero(np.diff(own.indptr)) + first
        offsets = np.r_[0, np.cumsum(np.diff(own.indptr)[rows - first])]
        add, kind = self.matrix.setValuesIJV, PETSc.IntType
        values = own.data, PETSc.InsertMode.ADD_VALUES, rows.astype(kind)
        add(offsets.astype(kind), own.indices.astype(kind), *values)

    def finish(self, blocks: Array | None = None) -> None:
        """Condense the interface and complete the matrix. Collective.

        Blocks of the bodies themselves have the shape (bodies, 6 + m, 6 + m), equal on all ranks.
        """
        if self._interface is not None:
            self._interface.insert_into(self.matrix)
        if blocks is None:
            self.matrix.assemble()
        else:
            self._prolongation.add_blocks(self.matrix, blocks)

    def _insert(self, interior: fem.Form) -> None:
        if not self._has_interior:  # then a step is so short that the mere calls count
            return
        if self._prolongation.nodal:
            fem_petsc.assemble_matrix(self.matrix, interior)
        else:
            assemble_unrolled(self.matrix, interior)

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self.matrix.destroy()
        if self._interface is not None:
            self._interface.destroy()

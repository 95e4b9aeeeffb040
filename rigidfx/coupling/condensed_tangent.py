"""The reduced tangent, assembled from flexible cells in the solver's own format.

The cells at the *interface* of rigid bodies are assembled into a matrix K of their own; PETSc's
MatPtAP condenses it by a master-slave prolongation to Lᵀ K P, test functions by L and trial ones by
P, which is the consistent tangent: see `interface`. The *interior* cells, most of them as a rule,
touch no body: their entries are only renumbered on the way into the reduced matrix, those of
prescribed dofs being dropped, by PETSc's local-to-global map. So condensing costs as much as the
interface. Where free dofs come in whole nodes the reduced matrix is blocked (BAIJ), in which
assembly takes two thirds and a Krylov iteration three fifths of the time of AIJ.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.base.compat import assemble_unrolled
from rigidfx.base.types import Array, Indices
from rigidfx.coupling.interface import Interface
from rigidfx.coupling.moved_nodes import condensed_row_lengths
from rigidfx.coupling.prolongation import Prolongation

__all__ = ["CondensedMatrix"]

SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
SUBSET = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN


class CondensedMatrix:
    """A bilinear form over the flexible cells, condensed; `destroy` frees it.

    Attributes:
        matrix: The reduced matrix, of fixed pattern.
    """

    def __init__(
        self,
        prolongation: Prolongation,
        interior: fem.Form,
        interface: fem.Form,
    ) -> None:
        """Find the pattern. Collective.

        Args:
            prolongation: Map between unknowns and dofs.
            interior: The form over flexible cells that touch no body.
            interface: The form over flexible cells that touch a body; of no meaning without bodies.
        """
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
        """Assemble the form anew. Collective.

        Args:
            other: Another form over the interior and the interface cells, instead; none if None.
        """
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
        """Add to the diagonal blocks of free nodes. Collective.

        Args:
            nodes: Owned nodes of flexible cells.
            blocks: Shape (nodes, 3, 3); entries of prescribed dofs are dropped.
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
        """Add to rows and columns of any unknowns; the pattern grows where it has to. Collective.

        Args:
            entries: All of them, equal on all ranks, by the numbers of the unknowns.
        """
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

        Args:
            blocks: Addition of the bodies themselves, shape (bodies, 6 + m, 6 + m), equal on all
                ranks;
                nothing if None.
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

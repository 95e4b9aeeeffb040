"""The reduced tangent, assembled from flexible cells in the solver's own format.

Most flexible cells touch no rigid body: their entries are only renumbered on the way into the
reduced matrix, supported dofs being dropped, by PETSc's local-to-global map. The cells at the *rim*
of bodies are assembled into a matrix K of their own, which is condensed to

    Lᵀ K P = Pᵀ K P + (L - P)ᵀ K P

by MatPtAP with reuse and a product as thin as L - P is, and added. So the product costs what the
interface costs. Where free dofs come in whole nodes the reduced matrix is blocked (BAIJ), in which
assembly takes two thirds and a Krylov iteration three fifths of the time of AIJ.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from petsc4py import PETSc

from rigidfx._compat import assemble_unrolled
from rigidfx.linear import default_options
from rigidfx.prolongation import Prolongation

__all__ = ["CondensedMatrix"]

SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
SUBSET = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN


class CondensedMatrix:
    """A bilinear form over the flexible cells, condensed; `destroy` frees it.

    Attributes:
        matrix: The reduced matrix, of fixed pattern.
    """

    def __init__(
        self, prolongation: Prolongation, core: fem.Form, rim: fem.Form, thin: bool = True
    ) -> None:
        """Find the pattern. Collective.

        Args:
            prolongation: Map between unknowns and dofs.
            core: The form over flexible cells away from bodies.
            rim: The form over flexible cells that touch a body; of no meaning without bodies.
            thin: Whether the test side is L and not P; without it Newton converges linearly.
        """
        self._prolongation, self._core, self._thin = prolongation, core, thin
        self.matrix = prolongation.empty_matrix()
        self._insert_core()
        self._touched = prolongation.touched
        if self._touched:
            self._rim = rim
            self._K = prolongation.partition.rows.matrix(PETSc.Mat.Type.BAIJ)
            fem_petsc.assemble_matrix(self._K, rim)
            self._K.assemble()
            self._unblocked = self._K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
            self._products = self._first_products()
            self._find_blocks()
            self._insert_rim()
        bodies = len(prolongation.partition.bodies)
        prolongation.add_blocks(self.matrix, np.zeros((bodies, 6, 6)))
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)

    def assemble(self) -> None:
        """Assemble the form anew. Collective."""
        self.matrix.zeroEntries()
        self._insert_core()
        if self._touched:
            self._K.zeroEntries()
            fem_petsc.assemble_matrix(self._K, self._rim)
            self._K.assemble()

    def add(self, other: CondensedMatrix, factor: float) -> None:
        """Add a multiple of another form of the same partition before bodies are condensed."""
        self.matrix.assemble()
        self.matrix.axpy(factor, other.matrix, SAME)
        if self._touched:
            self._K.axpy(factor, other._K, SAME)

    def add_nodal(self, nodes: npt.NDArray[np.int32], blocks: npt.NDArray[np.float64]) -> None:
        """Add to the diagonal blocks of free nodes. Collective.

        Args:
            nodes: Owned nodes of flexible cells.
            blocks: Shape (nodes, 3, 3); what belongs to held dofs is dropped.
        """
        offsets = np.arange(nodes.size + 1, dtype=PETSc.IntType)
        self.matrix.assemble()
        if self._prolongation.nodal:
            rows, add = nodes.astype(PETSc.IntType), self.matrix.setValuesBlockedLocalIJV
        else:
            rows = (3 * nodes[:, None] + np.arange(3)).reshape(-1).astype(PETSc.IntType)
            offsets = 3 * np.arange(rows.size + 1, dtype=PETSc.IntType)
            add = self.matrix.setValuesLocalIJV
        columns = rows if self._prolongation.nodal else np.repeat(rows.reshape(-1, 3), 3, axis=0)
        add(offsets, columns.reshape(-1), blocks.reshape(-1), PETSc.InsertMode.ADD_VALUES, rows)

    def finish(self) -> None:
        """Condense the rim and complete the matrix. Collective."""
        if self._touched:
            self._condense()
            self._insert_rim()
        self.matrix.assemble()

    def _insert_core(self) -> None:
        if self._prolongation.nodal:
            fem_petsc.assemble_matrix(self.matrix, self._core)
        else:
            assemble_unrolled(self.matrix, self._core)

    def _first_products(self) -> list[PETSc.Mat]:
        """Pᵀ K P, (L - P)ᵀ K and (L - P)ᵀ K P, whose patterns are final with K's. Collective."""
        K, P, D = self._unblocked, self._prolongation.P, self._prolongation.D
        # With Pᵀ at hand it takes a third of the time of PETSc's default; across ranks this way
        # does not exist.
        way = {"matptap_via": "rap"} if K.comm.size == 1 else {}
        with default_options("", **way):
            product = K.PtAP(P)
        DK = D.transposeMatMult(K)
        return [product, DK, DK.matMult(P)]

    def _condense(self) -> None:
        self._prolongation.rotate_trial()
        K, P, D = self._unblocked, self._prolongation.P, self._prolongation.D
        product, DK, DKP = self._products
        self._K.convert(PETSc.Mat.Type.AIJ, K)
        K.PtAP(P, result=product)
        if self._thin:
            D.transposeMatMult(K, result=DK)
            DK.matMult(P, result=DKP)
            product.axpy(1.0, DKP, SUBSET)

    def _find_blocks(self) -> None:
        """Where the product has blocks of the reduced matrix, and where their values are in it.

        K has whole nodes and P whole bodies, so these blocks are full.
        """
        product, block = self._products[0], self.matrix.getBlockSize()
        offsets, columns, _ = product.getValuesCSR()
        width = np.diff(offsets)
        rows = np.repeat(np.arange(width.size), width)
        corner = np.flatnonzero((rows % block == 0) & (columns % block == 0))
        filled, counts = np.unique(rows[corner], return_counts=True)
        down, right = np.indices((block, block))
        places = corner[:, None, None] + width[rows[corner], None, None] * down + right
        self._places = places.reshape(-1)
        self._columns = (columns[corner] // block).astype(PETSc.IntType)
        self._offsets = np.r_[0, np.cumsum(counts)].astype(PETSc.IntType)
        first = product.getOwnershipRange()[0]
        self._row_numbers = ((first + filled) // block).astype(PETSc.IntType)

    def _insert_rim(self) -> None:
        _, _, values = self._products[0].getValuesCSR()
        self.matrix.setValuesBlockedIJV(
            self._offsets,
            self._columns,
            values[self._places],
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=self._row_numbers,
        )

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self.matrix.destroy()
        if self._touched:
            for item in (self._K, self._unblocked, *self._products):
                item.destroy()

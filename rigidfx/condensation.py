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
from rigidfx.prolongation import Prolongation

__all__ = ["CondensedMatrix"]

SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN


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
        self._with_bodies = bool(prolongation.partition.bodies)
        self._products: dict[str, PETSc.Mat] = {}
        self.matrix = prolongation.empty_matrix()
        self._insert_core()
        if self._with_bodies:
            self._rim = rim
            self._K = fem_petsc.create_matrix(rim)
            fem_petsc.assemble_matrix(self._K, rim)  # or assembly drops the pattern
            _insert_anchors(self._K, prolongation.partition.anchors)
            self._condense()
            self._insert_rim()
            prolongation.add_blocks(
                self.matrix, np.zeros((len(prolongation.partition.bodies), 6, 6))
            )
        self.matrix.assemble()
        self.matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)

    def assemble(self) -> None:
        """Assemble the form anew. Collective."""
        self.matrix.zeroEntries()
        self._insert_core()
        if self._with_bodies:
            self._K.zeroEntries()
            fem_petsc.assemble_matrix(self._K, self._rim)
            self._K.assemble()

    def add(self, other: CondensedMatrix, factor: float) -> None:
        """Add a multiple of another form of the same partition before bodies are condensed."""
        self.matrix.assemble()
        self.matrix.axpy(factor, other.matrix, SAME)
        if self._with_bodies:
            self._K.axpy(factor, other._K, SAME)

    def finish(self) -> None:
        """Condense the rim and complete the matrix. Collective."""
        if self._with_bodies:
            self._condense()
            self._insert_rim()
        self.matrix.assemble()

    def _insert_core(self) -> None:
        if self._prolongation.nodal:
            fem_petsc.assemble_matrix(self.matrix, self._core)
        else:
            assemble_unrolled(self.matrix, self._core)

    def _condense(self) -> None:
        self._prolongation.rotate_trial()
        P, C = self._prolongation.P, self._products
        D: PETSc.Mat = self._prolongation.D
        if not C:
            C["PKP"] = self._K.PtAP(P)
            if self._thin:
                C["DK"] = D.transposeMatMult(self._K)
                C["DKP"] = C["DK"].matMult(P)
            return
        self._K.PtAP(P, result=C["PKP"])
        if self._thin:
            D.transposeMatMult(self._K, result=C["DK"])
            C["DK"].matMult(P, result=C["DKP"])
            C["PKP"].axpy(1.0, C["DKP"], PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)

    def _insert_rim(self) -> None:
        product = self._products["PKP"]
        offsets, columns, values = product.getValuesCSR()
        filled = np.flatnonzero(np.diff(offsets))
        self.matrix.setValuesIJV(
            np.append(offsets[filled], offsets[-1:]).astype(PETSc.IntType),
            columns,
            values,
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=(product.getOwnershipRange()[0] + filled).astype(PETSc.IntType),
        )

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self.matrix.destroy()
        if self._with_bodies:
            self._K.destroy()
        for product in self._products.values():
            product.destroy()


def _insert_anchors(K: PETSc.Mat, nodes: npt.NDArray[np.int32]) -> None:
    """Give rows of bodies that nothing pulls at an (empty) block of their own. Collective."""
    K.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
    for node in nodes:
        index = (K.getOwnershipRange()[0] + 3 * node + np.arange(3)).astype(PETSc.IntType)
        K.setValues(index, index, np.zeros((3, 3)))
    K.assemble()

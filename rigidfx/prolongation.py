"""Between the full vector of displacement increments and the unknowns of a step.

d = P y + d_s: the columns of P are the unknowns, its rows all dofs. A supported dof has no column;
its increment is prescribed in d_s. The residual of the step is restricted by Pᵀ and the tangent
condensed to Pᵀ K P, so that no rows of ones, no penalties and no empty rows ever reach the solver.

Where P only selects whole nodes, Pᵀ K P is a submatrix of blocks and K is kept in PETSc's blocked
format (BAIJ), in which assembly takes two thirds and a Krylov iteration half of the time of AIJ.
Anything else is MatPtAP, which wants AIJ. Where nothing is supported K itself is the product.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

__all__ = ["Prolongation"]


class Prolongation:
    """P of one partition of the dofs; `destroy` frees its PETSc objects.

    Attributes:
        mask: For each owned dof, whether it is prescribed.
        free: Local numbers of this rank's owned dofs that are unknowns, sorted.
        held: Local numbers of the owned dofs that are prescribed, sorted.
        nodal: Whether the unknowns come in whole nodes, three at a time.
        size: Number of unknowns over all ranks.
    """

    def __init__(self, held: npt.NDArray[np.bool_], comm: MPI.Comm) -> None:
        """Build P. Collective.

        Args:
            held: For each owned dof, whether it is prescribed, shape (3 · owned nodes,).
            comm: Communicator of the mesh.
        """
        self.mask = held
        self.free = np.flatnonzero(~held)
        self.held = np.flatnonzero(held)
        self.comm = comm
        self.size = int(comm.allreduce(self.free.size))
        self._rows, self._columns = held.size, self.free.size
        by_node = held.reshape(-1, 3)
        broken = int(np.count_nonzero(by_node.any(axis=1) & ~by_node.all(axis=1)))
        self.nodal = comm.allreduce(broken) == 0
        self._P: PETSc.Mat | None = None
        self._blocks: PETSc.IS | None = None
        self._reduced: PETSc.Mat | None = None
        if comm.allreduce(self.held.size) > 0:
            self._P = self._selection()
            if self.nodal:
                self._blocks = self._node_blocks()

    @property
    def matrix_type(self) -> str:
        """PETSc's format of the tangent that `condense` wants."""
        return "baij" if self.nodal else "aij"

    def _node_blocks(self) -> PETSc.IS:
        first = self.comm.exscan(self._rows) or 0
        nodes = (first + self.free[::3]) // 3
        return PETSc.IS().createBlock(3, nodes.astype(PETSc.IntType), comm=self.comm)

    def _selection(self) -> PETSc.Mat:
        offsets = np.zeros(self._rows + 1, dtype=PETSc.IntType)
        offsets[self.free + 1] = 1
        first = self.comm.exscan(self._columns) or 0
        columns = np.arange(first, first + self._columns, dtype=PETSc.IntType)
        P = PETSc.Mat().createAIJ(
            [(self._rows, None), (self._columns, None)],
            csr=(np.cumsum(offsets, dtype=PETSc.IntType), columns, np.ones(self._columns)),
            comm=self.comm,
        )
        P.assemble()
        return P

    def unknowns(self) -> PETSc.Vec:
        """A new vector of unknowns; the caller destroys it."""
        y = PETSc.Vec().create(self.comm)
        y.setSizes((self._columns, None))
        y.setType(PETSc.Vec.Type.STANDARD)
        return y

    def expand(self, y: PETSc.Vec, prescribed: npt.NDArray[np.float64], d: PETSc.Vec) -> None:
        """D = P y + d_s.

        Args:
            y: Unknowns.
            prescribed: Increments of the held dofs [m], in their order.
            d: Full-length vector, overwritten.
        """
        if self._P is None:
            y.copy(d)
            return
        self._P.mult(y, d)
        d.array[self.held] = prescribed

    def collapse(self, d: PETSc.Vec, y: PETSc.Vec) -> None:
        """The unknowns of a full-length increment: y of which d is the expansion."""
        y.array[:] = d.array_r[self.free]

    def restrict(self, f: PETSc.Vec, r: PETSc.Vec) -> None:
        """R = Pᵀ f."""
        if self._P is None:
            f.copy(r)
        else:
            self._P.multTranspose(f, r)

    def condense(self, K: PETSc.Mat) -> PETSc.Mat:
        """Pᵀ K P; the product's pattern is reused from the second call on. Collective.

        Args:
            K: Full tangent in the format `matrix_type`, of unchanged pattern.

        Returns:
            The reduced tangent, owned by this object (or K, where P is the identity).
        """
        if self._P is None:
            return K
        blocks = self._blocks
        if self._reduced is None:
            self._reduced = (
                K.createSubMatrix(blocks, blocks) if blocks is not None else K.PtAP(self._P)
            )
        elif blocks is not None and self.comm.size == 1:
            K.createSubMatrix(blocks, blocks, submat=self._reduced)
        elif blocks is not None:
            # PETSc does not refill a blocked submatrix that is spread over ranks ("Previous matrix
            # must be same size/layout as request", seen with 3.22).
            fresh = K.createSubMatrix(blocks, blocks)
            fresh.copy(self._reduced, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            fresh.destroy()
        else:
            K.PtAP(self._P, result=self._reduced)
        return self._reduced

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._P, self._blocks, self._reduced):
            if item is not None:
                item.destroy()
        self._P = self._blocks = self._reduced = None

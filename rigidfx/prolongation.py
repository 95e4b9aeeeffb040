"""Between the full vector of displacement increments and the unknowns of a step.

d = P y + d_s: the columns of P are the unknowns, its rows all dofs. A supported dof has no column;
its increment is prescribed in d_s. The residual of the step is restricted by Pᵀ and the tangent
condensed to Pᵀ K P by MatPtAP, so that no rows of ones, no penalties and no empty rows ever reach
the solver. Where nothing is supported P is the identity and K itself is the reduced tangent.
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
        self._P: PETSc.Mat | None = None
        self._reduced: PETSc.Mat | None = None
        if comm.allreduce(self.held.size) > 0:
            self._P = self._selection()

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
            K: Full tangent, of unchanged pattern.

        Returns:
            The reduced tangent, owned by this object (or K, where P is the identity).
        """
        if self._P is None:
            return K
        if self._reduced is None:
            self._reduced = K.PtAP(self._P)
        else:
            K.PtAP(self._P, result=self._reduced)
        return self._reduced

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for matrix in (self._P, self._reduced):
            if matrix is not None:
                matrix.destroy()
        self._P = self._reduced = None

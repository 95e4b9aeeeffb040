"""Between the full vector of displacement increments and the unknowns of a step.

The unknowns y are the increments of the free dofs and, for each rigid body, Δr and ℓθ. The step's
displacement lies exactly in the range of L,

    d = L y + d_s,    rows [I, -v̂_av/ℓ] at attached nodes, unit rows at free dofs,

so the residual is restricted by Lᵀ, equations (5) and (13); the derivative of d is P, with rows
[I, -v̂₁ T/ℓ]. A supported dof has no column and its increment is prescribed in d_s; a node inside a
body has no entries at all. So no rows of ones, no penalties and no empty rows ever reach the
solver. The tangent is condensed to

    Lᵀ K P = Pᵀ K P + (L - P)ᵀ K P,

by MatPtAP and a product as thin as L - P is: it has the rotation columns of attached nodes only.

Where P only selects whole nodes, Pᵀ K P is a submatrix of blocks and K is kept in PETSc's blocked
format (BAIJ), in which assembly takes two thirds and a Krylov iteration half of the time of AIJ.
Where nothing is supported or rigid, K itself is the product.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.body import BodyMotion, Increment
from rigidfx.partition import Partition
from rigidfx.rotation import skew

__all__ = ["Prolongation"]

Array = npt.NDArray[np.float64]
Int = PETSc.IntType


class Prolongation:
    """L and P of one partition; `destroy` frees the PETSc objects.

    Attributes:
        partition: What it is made for.
        free: Local numbers of this rank's owned dofs that are unknowns, sorted.
        held: Local numbers of the owned dofs that are prescribed, sorted.
        size: Number of unknowns over all ranks.
        increments: Trial increments of the bodies, set by `expand`; equal on all ranks.
    """

    def __init__(self, partition: Partition, comm: MPI.Intracomm, thin: bool = True) -> None:
        """Build the patterns. Collective.

        Args:
            partition: Division of the dofs.
            comm: Communicator of the mesh.
            thin: Whether `condense` adds (L - P)ᵀ K P; without it Newton converges linearly.
        """
        self.partition, self.comm, self._thin = partition, comm, thin
        self.free = np.flatnonzero(partition.free)
        self.held = np.flatnonzero(partition.held)
        bodies = partition.bodies
        self._owners = _owners(partition, comm)
        self._mine = [k for k, rank in enumerate(self._owners) if rank == comm.rank]
        self._rows = partition.held.size
        self._columns = self.free.size + 6 * len(self._mine)
        self.size = int(comm.allreduce(self._columns))
        self.increments: tuple[Increment, ...] = ()
        by_node = partition.free.reshape(-1, 3)
        broken = int(np.count_nonzero(by_node.any(axis=1) & ~by_node.all(axis=1)))
        self._nodal = comm.allreduce(broken) == 0
        self._selects = not bodies
        self._identity = self.size == comm.allreduce(self._rows) and self._selects
        self._first_row = comm.exscan(self._rows) or 0
        self._first_column = comm.exscan(self._columns) or 0
        self._body_columns = self._locate_bodies()
        self._L = self._P = self._D = None
        self._blocks: PETSc.IS | None = None
        self._products: dict[str, PETSc.Mat] = {}
        if self._identity:
            return
        if self._selects and self._nodal:
            nodes = (self._first_row + self.free[::3]) // 3
            self._blocks = PETSc.IS().createBlock(3, nodes.astype(Int), comm=comm)
        self._L = self._create(selection=True)
        self._P = self._create(selection=True) if bodies else self._L
        if bodies and thin:
            self._D = self._create(selection=False)

    # Patterns -----------------------------------------------------------------------------------

    @property
    def matrix_type(self) -> str:
        """PETSc's format of the full tangent that `condense` wants."""
        return "baij" if self._selects and self._nodal else "aij"

    def _locate_bodies(self) -> list[int]:
        """First global column of each body; bodies come last among their owner's columns."""
        first = np.zeros(len(self._owners), dtype=np.int64)
        for place, k in enumerate(self._mine):
            first[k] = self._first_column + self.free.size + 6 * place
        total = self.comm.allreduce(first, op=MPI.SUM) if len(first) else first
        return [int(c) for c in total]

    def _attached(self) -> list[npt.NDArray[np.int64]]:
        """Owned dofs of each body's attached nodes, three a node."""
        bodies, attached = self.partition.bodies, self.partition.attached
        return [
            (3 * body.nodes[at].astype(np.int64)[:, None] + np.arange(3)).reshape(-1)
            for body, at in zip(bodies, attached, strict=True)
        ]

    def _create(self, selection: bool) -> PETSc.Mat:
        """A matrix of the pattern of L and P, or of L - P only. Collective.

        Args:
            selection: Whether it has the constant unit entries.
        """
        rows = [self.free] if selection else []
        columns = [self._first_column + np.arange(self.free.size)] if selection else []
        values = [np.ones(self.free.size)] if selection else []
        for first, dofs in zip(self._body_columns, self._attached(), strict=True):
            if selection:
                rows.append(dofs)
                columns.append(first + dofs % 3)
                values.append(np.ones(dofs.size))
            rows.append(np.repeat(dofs, 3))
            columns.append(np.tile(first + np.arange(3, 6), dofs.size))
            values.append(np.zeros(3 * dofs.size))
        row, column = np.concatenate(rows), np.concatenate(columns)
        order = np.lexsort((column, row))
        offsets = np.r_[0, np.cumsum(np.bincount(row, minlength=self._rows))].astype(Int)
        entries = column[order].astype(Int), np.concatenate(values)[order]
        A = PETSc.Mat().createAIJ(
            [(self._rows, None), (self._columns, None)],
            csr=(offsets, *entries),
            comm=self.comm,
        )
        A.assemble()
        return A

    def _rotate(self, A: PETSc.Mat, rotations: Sequence[Array]) -> None:
        """Set the rotation columns, shape (nodes, 3, 3) per body. Collective."""
        for first, dofs, rotation in zip(
            self._body_columns, self._attached(), rotations, strict=True
        ):
            A.setValuesIJV(
                np.arange(0, 3 * dofs.size + 1, 3, dtype=Int),
                np.tile(first + np.arange(3, 6), dofs.size).astype(Int),
                rotation.reshape(-1),
                rowmap=(self._first_row + dofs).astype(Int),
            )
        A.assemble()

    # Vectors ------------------------------------------------------------------------------------

    def unknowns(self) -> PETSc.Vec:
        """A new vector of unknowns; the caller destroys it."""
        y = PETSc.Vec().create(self.comm)
        y.setSizes((self._columns, None))
        y.setType(PETSc.Vec.Type.STANDARD)
        return y

    def expand(
        self,
        y: PETSc.Vec,
        motions: Sequence[BodyMotion],
        dt: float,
        prescribed: Array,
        d: PETSc.Vec,
    ) -> None:
        """D = L y + d_s, with L rotated to the unknowns. Collective.

        Args:
            y: Unknowns.
            motions: Motions of the bodies at the begin of the step.
            dt: Δt [s].
            prescribed: Increments of the held dofs [m], in their order.
            d: Full-length vector, overwritten.
        """
        self.rotate(y, motions, dt)
        self.apply(y, prescribed, d)

    def apply(self, y: PETSc.Vec, prescribed: Array, d: PETSc.Vec) -> None:
        """D = L y + d_s with L as it is."""
        if self._L is None:
            y.copy(d)
            return
        self._L.mult(y, d)
        d.array[self.held] = prescribed

    def rotate(self, y: PETSc.Vec, motions: Sequence[BodyMotion], dt: float) -> None:
        """Set L, P and the bodies' increments to the unknowns y. Collective."""
        if not self.partition.bodies:
            return
        values = self.bodies_part(y)
        self.increments = tuple(
            Increment(body, motion, values[k, :3], np.asarray(values[k, 3:] / body.length), dt)
            for k, (body, motion) in enumerate(zip(self.partition.bodies, motions, strict=True))
        )
        L, P = [], []
        for increment, attached in zip(self.increments, self.partition.attached, strict=True):
            offsets = increment.body.offsets[attached]
            L.append(increment.test_rows(offsets))
            P.append(increment.trial_rows(offsets))
        self._rotate(self._L, L)
        self._rotate(self._P, P)
        if self._D is not None:
            self._rotate(self._D, [a - b for a, b in zip(L, P, strict=True)])

    def bodies_part(self, y: PETSc.Vec) -> Array:
        """The six unknowns of each body, shape (bodies, 6), on all ranks. Collective."""
        values = np.zeros((len(self.partition.bodies), 6))
        values[self._mine] = y.array_r[self.free.size :].reshape(-1, 6)
        return np.asarray(self.comm.allreduce(values, op=MPI.SUM))

    def collapse(self, d: PETSc.Vec, bodies: Array, y: PETSc.Vec) -> None:
        """Unknowns from a full-length vector at the free dofs and six numbers per body.

        Args:
            d: Full-length vector.
            bodies: Shape (bodies, 6), equal on all ranks.
            y: Unknowns, overwritten.
        """
        y.array[: self.free.size] = d.array_r[self.free]
        y.array[self.free.size :] = bodies[self._mine].reshape(-1)

    def restrict(self, f: PETSc.Vec, bodies: Array, r: PETSc.Vec) -> None:
        """R = Lᵀ f plus the bodies' own six numbers each.

        Args:
            f: Full-length vector.
            bodies: Shape (bodies, 6), equal on all ranks.
            r: Overwritten.
        """
        if self._L is None:
            f.copy(r)
            return
        self._L.multTranspose(f, r)
        r.array[self.free.size :] += bodies[self._mine].reshape(-1)

    def couples(self, f: PETSc.Vec) -> Array:
        """Σ ½ f̂ᵢ v̂₁,ᵢ over each body's attached nodes, shape (bodies, 3, 3). Collective."""
        nodal = f.array_r.reshape(-1, 3)
        out = np.zeros((len(self.increments), 3, 3))
        for k, (inc, at) in enumerate(zip(self.increments, self.partition.attached, strict=True)):
            v1 = inc.body.offsets[at] @ inc.R1.T
            out[k] = 0.5 * np.einsum(
                "nij,njk->ik", skew(nodal[inc.body.nodes[at]]), skew(v1), optimize=True
            )
        return self.comm.allreduce(out, op=MPI.SUM) if self.comm.size > 1 else out

    # Matrices -----------------------------------------------------------------------------------

    def condense(self, K: PETSc.Mat) -> PETSc.Mat:
        """Lᵀ K P; patterns are reused from the second call on. Collective.

        Args:
            K: Full tangent in the format `matrix_type`, of unchanged pattern.

        Returns:
            The reduced tangent, owned by this object (or K, where P is the identity).
        """
        if self._identity:
            return K
        C = self._products
        if self._blocks is not None:
            blocks = self._blocks
            if "C" not in C:
                C["C"] = K.createSubMatrix(blocks, blocks)
            elif self.comm.size == 1:
                K.createSubMatrix(blocks, blocks, submat=C["C"])
            else:
                # PETSc does not refill a blocked submatrix that is spread over ranks ("Previous
                # matrix must be same size/layout as request", seen with 3.22).
                fresh = K.createSubMatrix(blocks, blocks)
                fresh.copy(C["C"], structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
                fresh.destroy()
            return C["C"]
        if "C" in C:
            K.PtAP(self._P, result=C["C"])
        else:
            C["C"] = K.PtAP(self._P)
        if self._D is not None:
            if "DK" in C:
                self._D.transposeMatMult(K, result=C["DK"])
                C["DK"].matMult(self._P, result=C["DKP"])
            else:
                C["DK"] = self._D.transposeMatMult(K)
                C["DKP"] = C["DK"].matMult(self._P)
            C["C"].axpy(1.0, C["DKP"], PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return C["C"]

    def add_blocks(self, C: PETSc.Mat, blocks: Array) -> None:
        """Add a 6×6 block per body to a reduced matrix. Collective.

        Args:
            C: Reduced tangent.
            blocks: Shape (bodies, 6, 6), equal on all ranks.
        """
        for k in self._mine:
            index = (self._body_columns[k] + np.arange(6)).astype(Int)
            C.setValues(index, index, blocks[k], addv=PETSc.InsertMode.ADD_VALUES)
        if self.partition.bodies:
            C.assemble()

    def solvable(self, C: PETSc.Mat) -> PETSc.Mat:
        """The reduced tangent in the format that is solved fastest. Collective.

        Args:
            C: What `condense` gave, with all that was added to it.
        """
        if self._selects or not self._nodal:
            return C
        if "solvable" in self._products:
            C.convert("baij", self._products["solvable"])
        else:
            C.setBlockSizes(3, 3)
            self._products["solvable"] = C.convert("baij", PETSc.Mat())
        return self._products["solvable"]

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self._L, self._P, self._D, self._blocks, *self._products.values()):
            if item is not None:
                item.destroy()
        self._L = self._P = self._D = self._blocks = None
        self._products = {}


def _owners(partition: Partition, comm: MPI.Intracomm) -> list[int]:
    """Rank that owns the unknowns of each body: the first with most of its attached nodes."""
    owners = []
    for attached in partition.attached:
        counts = comm.allgather(len(attached))
        owners.append(counts.index(max(counts)))
    return owners

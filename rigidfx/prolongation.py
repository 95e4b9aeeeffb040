"""Between the full vector of displacement increments and the unknowns of a step.

The unknowns y are the increments of the free dofs and, for each rigid body, Δr and ℓθ. The step's
displacement lies exactly in the range of L,

    d = L y + d_s,    rows [I, -v̂_av/ℓ] at attached nodes, unit rows at free dofs,

so the residual is restricted by Lᵀ, equations (5) and (13); the derivative of d is P, with rows
[I, -v̂₁ T/ℓ]. A supported dof has no column and its increment is prescribed in d_s; a node inside a
body has no entries at all. So no rows of ones, no penalties and no empty rows ever reach the
solver. `condensation` makes the reduced tangent with them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.body import BodyMotion, Increment
from rigidfx.partition import Partition

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
        nodal: Whether free dofs come in whole nodes, three at a time.
        increments: Trial increments of the bodies, set by `expand`; equal on all ranks.
        L: Test side, rows as above; None where all dofs are unknowns.
        P: Trial side.
        D: L - P, in the rows of attached nodes only; None without bodies.
    """

    def __init__(self, partition: Partition, comm: MPI.Intracomm) -> None:
        """Build the patterns. Collective.

        Args:
            partition: Division of the dofs.
            comm: Communicator of the mesh.
        """
        self.partition, self.comm = partition, comm
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
        self.nodal = comm.allreduce(broken) == 0
        identity = not bodies and self.size == comm.allreduce(self._rows)
        self._first_row = comm.exscan(self._rows) or 0
        self._first_column = comm.exscan(self._columns) or 0
        self._body_columns = self._locate_bodies()
        nodes = [b.nodes[at] for b, at in zip(bodies, partition.attached, strict=True)]
        self._arms = [b.offsets[at] for b, at in zip(bodies, partition.attached, strict=True)]
        self._nodes = nodes
        dofs = [
            3 * np.repeat(own.astype(np.int64), 3) + np.tile([0, 1, 2], own.size) for own in nodes
        ]
        self._attached = np.concatenate([np.empty(0, np.int64), *dofs])
        sizes = [own.size for own in dofs]
        self._translations = np.repeat(np.asarray(self._body_columns, dtype=np.int64), sizes)
        turned = self._translations[:, None] + np.arange(3, 6)
        self._rotations = turned.reshape(-1).astype(Int)
        self._offsets = np.arange(0, self._rotations.size + 1, 3, dtype=Int)
        self._row_numbers = (self._first_row + self._attached).astype(Int)
        self.L: PETSc.Mat | None = None if identity else self._create(selection=True)
        self.P = self._create(selection=True) if bodies else self.L
        self.D = self._create(selection=False) if bodies else None

    # Patterns -----------------------------------------------------------------------------------

    def _locate_bodies(self) -> list[int]:
        """First global column of each body; bodies come last among their owner's columns."""
        first = np.zeros(len(self._owners), dtype=np.int64)
        for place, k in enumerate(self._mine):
            first[k] = self._first_column + self.free.size + 6 * place
        total = self.comm.allreduce(first, op=MPI.SUM) if len(first) else first
        return [int(c) for c in total]

    def _create(self, selection: bool) -> PETSc.Mat:
        """A matrix of the pattern of L and P, or of L - P only. Collective.

        Args:
            selection: Whether it has the constant unit entries.
        """
        rows = [self.free] if selection else []
        columns = [self._first_column + np.arange(self.free.size)] if selection else []
        values = [np.ones(self.free.size)] if selection else []
        if selection:
            rows.append(self._attached)
            columns.append(self._translations + self._attached % 3)
            values.append(np.ones(self._attached.size))
        rows.append(np.repeat(self._attached, 3))
        columns.append(self._rotations)
        values.append(np.zeros(self._rotations.size))
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

    def _fill(self, A: PETSc.Mat, rows: Array) -> None:
        """Set the rotation columns of all attached nodes, shape (nodes, 3, 3). Collective."""
        A.setValuesIJV(self._offsets, self._rotations, rows.reshape(-1), rowmap=self._row_numbers)
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
        if self.L is None:
            y.copy(d)
            return
        self.L.mult(y, d)
        d.array[self.held] = prescribed

    def rotate(self, y: PETSc.Vec, motions: Sequence[BodyMotion], dt: float) -> None:
        """Set L and the bodies' increments to the unknowns y. Collective."""
        if not self.partition.bodies:
            return
        values = self.bodies_part(y)
        self.increments = tuple(
            Increment(body, motion, values[k, :3], np.asarray(values[k, 3:] / body.length), dt)
            for k, (body, motion) in enumerate(zip(self.partition.bodies, motions, strict=True))
        )
        self._test = np.concatenate(
            [i.test_rows(arms) for i, arms in zip(self.increments, self._arms, strict=True)]
        )
        self._fill(self.L, self._test)

    def rotate_trial(self) -> None:
        """Set P and L - P where L is. Collective."""
        if not self.increments:
            return
        trial = np.concatenate(
            [i.trial_rows(arms) for i, arms in zip(self.increments, self._arms, strict=True)]
        )
        self._fill(self.P, trial)
        self._fill(self.D, self._test - trial)

    def bodies_part(self, y: PETSc.Vec) -> Array:
        """The six unknowns of each body, shape (bodies, 6), on all ranks. Collective."""
        values = np.zeros((len(self.partition.bodies), 6))
        values[self._mine] = y.array_r[self.free.size :].reshape(-1, 6)
        return self._sum(values)

    def _sum(self, values: Array) -> Array:
        """Sum over ranks, in place. Collective."""
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, values)
        return values

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
        if self.L is None:
            f.copy(r)
            return
        self.L.multTranspose(f, r)
        r.array[self.free.size :] += bodies[self._mine].reshape(-1)

    def couples(self, f: PETSc.Vec) -> Array:
        """Σ ½ f̂ᵢ v̂₁,ᵢ over each body's attached nodes, shape (bodies, 3, 3). Collective."""
        nodal = f.array_r.reshape(-1, 3)
        out = np.zeros((len(self.increments), 3, 3))
        for k, (increment, own) in enumerate(zip(self.increments, self._nodes, strict=True)):
            # f̂ v̂ = v fᵀ - (f·v) I
            moment = (self._arms[k] @ increment.R1.T).T @ nodal[own]
            out[k] = 0.5 * (moment - np.trace(moment) * np.eye(3))
        return self._sum(out)

    # Matrices -----------------------------------------------------------------------------------

    def empty_matrix(self) -> PETSc.Mat:
        """A reduced matrix without entries that maps local nodes (or dofs) to unknowns.

        Its first assembly finds the pattern. Collective.
        """
        block = 3 if self.nodal else 1
        numbers = self._numbers()[::block]
        numbers = np.where(numbers >= 0, numbers // block, -1).astype(Int)
        mapping = PETSc.LGMap().create(numbers, bsize=block, comm=self.comm)
        A = PETSc.Mat().create(self.comm)
        A.setSizes([(self._columns, None)] * 2)
        A.setType(PETSc.Mat.Type.BAIJ if self.nodal else PETSc.Mat.Type.AIJ)
        A.setBlockSize(block)
        A.setLGMap(mapping, mapping)
        A.setUp()
        mapping.destroy()
        return A

    def _numbers(self) -> npt.NDArray[np.int64]:
        """Unknown of each local dof, ghosts included; -1 where it has none. Collective."""
        numbers = fem.Function(self.partition.space)
        numbers.x.array[:] = -1.0
        numbers.x.array[self.free] = self._first_column + np.arange(self.free.size)
        numbers.x.scatter_forward()
        return numbers.x.array.astype(np.int64)

    def condense(self, K: PETSc.Mat) -> PETSc.Mat:
        """Pᵀ K P of a full matrix, as a new one, which the caller destroys. Collective."""
        self.rotate_trial()
        return K.copy() if self.P is None else K.PtAP(self.P)

    def add_blocks(self, C: PETSc.Mat, blocks: Array) -> None:
        """Add a 6×6 block per body to a reduced matrix. Collective.

        Args:
            C: Reduced tangent.
            blocks: Shape (bodies, 6, 6), equal on all ranks.
        """
        for k in self._mine:
            index = (self._body_columns[k] + np.arange(6)).astype(Int)
            C.setValues(index, index, blocks[k], addv=PETSc.InsertMode.ADD_VALUES)
        C.assemble()

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        for item in (self.L, self.P, self.D):
            if item is not None:
                item.destroy()
        self.L = self.P = self.D = None


def _owners(partition: Partition, comm: MPI.Intracomm) -> list[int]:
    """Rank that owns the unknowns of each body: the first with most of its attached nodes."""
    owners = []
    for attached in partition.attached:
        counts = comm.allgather(len(attached))
        owners.append(counts.index(max(counts)))
    return owners

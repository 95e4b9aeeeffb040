"""Between the increments of the active nodes and the unknowns of a step: d = L y + d_s.

Rows of L are [I, -v̂_av/ℓ, S Φ] at attached nodes, unit rows at free dofs. The residual is
restricted by Lᵀ, equations (5) and (13); the derivative of d is P, with rows [I, -v̂₁ T/ℓ, R₁ Φ].
The increment of a dof that a support prescribes is in d_s; a node inside a body has no row at all.

A body's nodes move by constant coordinates a = [1, V, Φ₁, ..., Φ_m] times a matrix of n = 4 + 3 m
rows, see `Increments`: N [3 n numbers of each body], N constant and sparse, moments by Nᵀ. PETSc
multiplies, by vectors whose numbers are NumPy's: a product of SciPy's takes three times as long
where bodies are small.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, vstack

from rigidfx.base.matrices import distributed
from rigidfx.base.types import Array, Ints
from rigidfx.coupling.dealt_rows import DealtRows
from rigidfx.coupling.dof_layout import DofLayout
from rigidfx.coupling.rows import Lengths, mapped_matrix
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Step, prepare
from rigidfx.mechanics.rotation import AXES
from rigidfx.mechanics.shaped_step import increments_of

Int = PETSc.IntType


class AttachedRows:
    """The rows of this rank that bodies of a layout hold.

    Attributes:
        rows: These rows, sorted.
        displacement: Displacement at the freeze, in their order [m].
        entries: N, with a row for each row of the layout, shape (rows, 3 n · bodies) [1, m].
    """

    def __init__(self, layout: DofLayout) -> None:
        rows, self._shape = layout.rows, layout.ensemble.frozen.shape
        height, count = 3 * self._shape[1], layout.ensemble.frozen.size
        displacement = np.zeros(rows.dofs.size)
        places, parts = [AXES[:0]], [csr_array((0, count))]
        for k, (body, at) in enumerate(zip(layout.bodies, layout.attached, strict=True)):
            own = 3 * rows.positions(body.nodes[at])[:, None] + AXES
            displacement[own] = body.displacement[at]
            a = np.repeat(body.coordinates(at), 3, axis=0)
            columns = height * k + 3 * np.arange(a.shape[1]) + np.tile(AXES, at.size)[:, None]
            begins = a.shape[1] * np.arange(len(a) + 1)
            parts.append(csr_array((a.ravel(), columns.ravel(), begins), shape=(len(a), count)))
            places.append(own.ravel())
        at_rows = np.concatenate(places)
        order = np.argsort(at_rows, kind="stable")
        every, at_rows = csr_array(vstack(parts, format="csr"))[order], at_rows[order]
        self.rows: Ints = np.unique(at_rows)
        self.displacement: Array = displacement[self.rows]

        def of(some: Ints) -> csr_array:
            ends = every.indptr[np.searchsorted(at_rows, np.r_[some, rows.dofs.size])]
            return csr_array((every.data, every.indices, ends), shape=(some.size, count))

        self.entries, own = of(np.arange(rows.dofs.size)), of(self.rows)
        self._numbers, self._at_rows = np.zeros(count), np.zeros(self.rows.size)
        vectors = (self._numbers, self._at_rows)
        self._of_bodies, self._of_rows = (
            PETSc.Vec().createWithArray(values, comm=PETSc.COMM_SELF) for values in vectors
        )
        self._N = distributed(own, own.shape, PETSc.COMM_SELF)

    def __len__(self) -> int:
        return self._at_rows.size

    def moved(self, numbers: Array) -> Array:
        """Their values by numbers of each body, (bodies, n, 3), to be used before the next call."""
        self._numbers[:] = numbers.reshape(-1)
        self._N.mult(self._of_bodies, self._of_rows)
        return self._at_rows

    def moments(self, f: Array) -> Array:
        """Sums over them of a number per row of the layout, shape (bodies, n, 3)."""
        self._at_rows[:] = f[self.rows]
        self._N.multTranspose(self._of_rows, self._of_bodies)
        return self._numbers.reshape(self._shape).copy()


class Prolongation:
    """L and P of one layout.

    Attributes:
        layout: Its layout.
        comm: Communicator of the mesh.
        dealt: Where unknowns of free dofs are that follow dealt cells; None where they are with
            their rows.
        free: Rows of this rank that are unknowns, of any rank, sorted.
        prescribed: Rows of this rank whose increments are given, sorted.
        size: Number of unknowns over all ranks.
        owned: Number of this rank's.
        nodal: Whether free dofs come in whole nodes, three at a time.
        no_bodies: Zero for each unknown of each body, shape (bodies, 6 + m).
        increments: Trial step of the bodies, set by `rotate` and `expand`; equal on all ranks.
        touched: Whether flexible cells touch any body.
        attached: Rows of the bodies' nodes, sorted.
        first_column: Number of this rank's first unknown; free dofs come first, node by node, and
            its bodies last.
        free_of_nodes: Which of the three dofs of nodes are unknowns of this rank, a row for each
            node that has any, shape (n, 3).
        own_free: Number of this rank's unknowns that are free dofs.
        numbers: Number of each row as an unknown, -1 if it is none.
        owned_bodies: Bodies whose unknowns are this rank's, sorted.
        moving: Those of these that no support holds.
        six: Places of Δr and ℓθ of each of `moving` among this rank's unknowns, shape (bodies, 6).
        body_columns: Numbers of the unknowns of each body, shape (bodies, 6 + m) with the largest
            m, -1 where a body has fewer; equal on all ranks.
    """

    def __init__(
        self, layout: DofLayout, comm: MPI.Intracomm, dealt: DealtRows | None = None
    ) -> None:
        """Number the unknowns, which may follow dealt cells. Collective."""
        self.layout, self.comm, self.dealt = layout, comm, dealt
        rows = layout.rows
        self._with_bodies = len(layout.bodies) > 0
        if self._with_bodies:
            prepare(comm)
        free = layout.free[rows.dofs]
        by_node = free.reshape(-1, 3)
        self.free = np.flatnonzero(free)
        self._nodes = np.flatnonzero(by_node.any(axis=1))
        self.free_of_nodes = by_node[self._nodes] if dealt is None else dealt.free
        self.own_free = int(np.count_nonzero(self.free_of_nodes))
        self.prescribed = np.flatnonzero(layout.prescribed[rows.dofs])
        self.owned_bodies = np.flatnonzero(_owners(layout, comm) == comm.rank)
        of_bodies = layout.ensemble.unknowns
        self._known = layout.ensemble.known
        self._own_known = self._known[self.owned_bodies]
        self.no_bodies: Array = np.zeros(self._known.shape)
        self._alike = bool(self._known.all())
        own = of_bodies[self.owned_bodies]
        self.owned = self.own_free + int(own.sum())
        moves = self._own_known[:, 0]
        self.moving = self.owned_bodies[moves]
        self.six = self.own_free + (np.cumsum(own) - own)[moves, None] + np.arange(6)
        every = self.owned_bodies.size == len(layout.bodies)
        self._own_bodies = slice(None) if every else self.owned_bodies
        self.size = int(comm.allreduce(self.owned))
        self.pose(layout.ensemble.at_rest)
        broken = int(np.count_nonzero(by_node.any(axis=1) & ~by_node.all(axis=1)))
        every = self.free.size == rows.dofs.size
        self._rows_of_free = slice(None) if every else self.free
        self._places = np.flatnonzero(self.free_of_nodes)
        self.nodal = comm.allreduce(broken) == 0 and not (of_bodies % 3).any()
        self.first_column: int = comm.exscan(self.owned) or 0
        self.numbers = np.full(rows.dofs.size, -1, dtype=np.int64)
        own_numbers = self.first_column + np.arange(self.own_free, dtype=np.float64)
        self.numbers[self.free] = self._at_rows(own_numbers)
        self.body_columns = self._number_bodies()
        each = [columns[columns >= 0] for columns in self.body_columns[self.owned_bodies]]
        lengths = [np.repeat(columns.size, columns.size) for columns in each]
        self._own_rows = np.concatenate([np.empty(0), *each]).astype(Int)
        self._own_csr = (
            np.r_[0, np.cumsum(np.concatenate([np.empty(0), *lengths]))].astype(Int),
            np.concatenate([np.empty(0), *(np.tile(c, c.size) for c in each)]).astype(Int),
        )
        both = self._own_known
        self._own_entries = both[:, :, None] & both[:, None, :]
        self.touched = comm.allreduce(sum(map(len, layout.attached))) > 0
        self._held = AttachedRows(layout)
        self.attached = self._held.rows

    def _number_bodies(self) -> Ints:
        """Numbers of the bodies' unknowns, which come last among their owner's. Collective."""
        columns = np.zeros(self._known.shape, dtype=np.int64)
        first = self.first_column + self.own_free
        columns[self.owned_bodies] = self._by_body(first + np.arange(self.owned - self.own_free))
        self.comm.Allreduce(MPI.IN_PLACE, columns)
        columns[~self._known] = -1
        return columns

    def _by_body(self, own: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Numbers of the unknowns of this rank's bodies, a row for each, zero where it has none."""
        if self._alike:
            return own.reshape(-1, self._known.shape[1])
        values = np.zeros(self._own_known.shape, dtype=own.dtype)
        values[self._own_known] = own
        return values

    # Vectors ------------------------------------------------------------------------------------

    def at_nodes(self, values: Array) -> Array:
        """Values of active nodes, at those of `free_of_nodes`, shape (n, k). Collective."""
        return values[self._nodes] if self.dealt is None else self.dealt.give(values)

    def at_unknowns(self, d: Array) -> Array:
        """Values of rows, at this rank's unknowns. Collective."""
        if self.dealt is None:
            return d[self._rows_of_free]
        return self.dealt.give(d.reshape(-1, 3)).reshape(-1)[self._places]

    def _at_rows(self, y: Array) -> Array:
        """Values of unknowns of free dofs, at this rank's rows of these. Collective."""
        if self.dealt is None:
            return y
        values = np.zeros(self.free_of_nodes.size)
        values[self._places] = y
        return self.dealt.take(values.reshape(-1, 3)).reshape(-1)[self._rows_of_free]

    def unknowns(self, more: int = 0) -> PETSc.Vec:
        """A new vector of unknowns, and of more on this rank, which the caller destroys."""
        y = PETSc.Vec().create(self.comm)
        y.setSizes((self.owned + more, None))
        y.setType(PETSc.Vec.Type.STANDARD)
        return y

    def expand(self, y: Array, step: Step, imposed: Array, d: PETSc.Vec) -> None:
        """Evaluate d = L y + d_s by unknowns of this rank, with L rotated to them. Collective.

        From then on these are not to be changed. Prescribed dofs have imposed increments [m].
        """
        if self._with_bodies:
            self.rotate(self._gathered(y), step)
        self._multiply(y, imposed, self.increments.displacement, d)

    def apply(self, y: PETSc.Vec, of_bodies: Array, imposed: Array, d: PETSc.Vec) -> None:
        """Evaluate d = L y + d_s with L as it is, by bodies' parts and imposed increments [m]."""
        self._multiply(y.array_r, imposed, self.increments.L @ of_bodies[:, :, None], d)

    def _multiply(self, y: Array, imposed: Array, moved: Array, d: PETSc.Vec) -> None:
        """Evaluate d by the unknowns and by the numbers of each body that moves rows."""
        out = d.array
        out[self._rows_of_free] = self._at_rows(y[: self.own_free])
        if self.prescribed.size:
            out[self.prescribed] = imposed
        if self.attached.size:
            out[self.attached] = self._held.moved(moved)

    def displacement(self, bodies: Bodies) -> Array:
        """Displacement of the attached nodes, in their rows, `attached` [m]."""
        return self._held.displacement + self._held.moved(bodies.moved)

    def rates(self, bodies: Bodies) -> Array:
        """Velocities of these by those of the bodies [m/s]."""
        return self._held.moved(bodies.pose_rate)

    def pose(self, bodies: Bodies) -> None:
        """Set L and P to those of θ = 0, where they agree and map velocities, equation (25)."""
        self.rotate(np.zeros((len(bodies), bodies.of.columns)), Step(bodies, 1.0))

    def rotate(self, unknowns: Array, step: Step) -> None:
        """Set the bodies' increments, and so L, to their unknowns, shape (bodies, 6 + m)."""
        self.increments = increments_of(step, unknowns)

    def bodies_part(self, y: PETSc.Vec) -> Array:
        """The unknowns of each body, shape (bodies, 6 + m), on all ranks. Collective."""
        return self._gathered(y.array_r.copy())

    def _gathered(self, y: Array) -> Array:
        """The same of unknowns that nobody changes. Collective."""
        own = self._by_body(y[self.own_free : self.owned])
        if self.comm.size == 1:
            return own
        values = np.zeros(self._known.shape)
        values[self.owned_bodies] = own
        return self.sum(values)

    def sum(self, values: Array) -> Array:
        """Sum over ranks, in place if values lie one behind the other. Collective."""
        values = np.ascontiguousarray(values)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def collapse(self, d: Array, bodies: Array, y: PETSc.Vec) -> None:
        """Collect unknowns y (or residuals) from rows, and bodies, (bodies, 6 + m). Collective."""
        values = y.array
        values[: self.own_free] = self.at_unknowns(d)
        if self.owned > self.own_free:
            own = bodies[self._own_bodies]
            of_bodies = own.reshape(-1) if self._alike else own[self._own_known]
            values[self.own_free : self.owned] = of_bodies

    def moments(self, f: PETSc.Vec, more: Array | None = None) -> Array:
        """Sum a fᵀ over each body's attached nodes, shape (bodies, n, 3). Collective.

        Their `Increments.resultant` is the part of Lᵀ f in the bodies' rows. Moments of further
        forces of this rank may be added.
        """
        if not self.touched and more is None:
            return np.zeros(self.layout.ensemble.frozen.shape)
        if not self.touched:
            return self.sum(np.array(more))
        own = self._held.moments(f.array_r)
        return self.sum(own if more is None else own + more)

    def restrict(self, f: PETSc.Vec, bodies: Array, r: PETSc.Vec) -> None:
        """Evaluate r = Lᵀ f plus the bodies' own numbers, shape (bodies, 6 + m). Collective."""
        self.collapse(f.array_r, bodies + self.increments.resultant(self.moments(f)), r)

    # Matrices -----------------------------------------------------------------------------------

    @property
    def space(self) -> Any:
        """Function space of the displacement on the mesh of the cells that tangents are over."""
        return self.layout.space if self.dealt is None else self.dealt.cells.space

    @property
    def dofs(self) -> Ints:
        """Owned dofs of `space` that are unknowns of this rank, in their order."""
        if self.dealt is None:
            return self.layout.rows.dofs[self.free]
        node, axis = np.nonzero(self.free_of_nodes)
        return 3 * self.dealt.nodes[node] + axis

    def rank_of(self, unknowns: Ints) -> Ints:
        """Rank of each of some unknowns, -1 where that is below zero. Collective."""
        firsts = np.array(self.comm.allgather(self.first_column))
        return np.searchsorted(firsts, unknowns, side="right") - 1

    def empty_matrix(self, lengths: Lengths) -> PETSc.Mat:
        """A reduced matrix without entries; see `rows.mapped_matrix`. Collective."""
        kind, block = (PETSc.Mat.Type.BAIJ, 3) if self.nodal else (PETSc.Mat.Type.AIJ, 1)
        numbers = self.first_column + np.arange(self.own_free)
        return mapped_matrix(self.space, self.dofs, numbers, lengths, kind, block)

    def trial(self) -> PETSc.Mat:
        """P where L is, as a new matrix, which the caller destroys. Collective."""
        bodies, height = len(self.layout.bodies), 3 * self.layout.ensemble.frozen.shape[1]
        pattern = np.ones((bodies, height, self._known.shape[1]), dtype=bool)
        pattern[:, :3, 3:6] = pattern[:, 3:, :3] = False
        pattern[self._known[:, 0], :3, 6:] = False
        body, row, column = np.nonzero(pattern & self._known[:, None])
        turning = csr_array(
            (
                self.increments.P[body, row, column],
                (height * body + row, self.body_columns[body, column]),
            ),
            shape=(height * bodies, self.size),
        )
        ones = np.ones(self.free.size), (self.free, self.numbers[self.free])
        P = csr_array(ones, shape=(self.numbers.size, self.size)) + self._held.entries @ turning
        P.sort_indices()
        return distributed(P, [(P.shape[0], None), (self.owned, None)], self.comm)

    def condense(self, K: PETSc.Mat, blocks: Array | None = None) -> PETSc.Mat:
        """Pᵀ K P of a matrix of all rows, as a new one, which the caller destroys. Collective.

        Blocks of bodies are added: see `add_blocks`.
        """
        P = self.trial()
        out = K.PtAP(P)
        P.destroy()
        # A body that no flexible cell touches has no entries yet.
        out.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        if blocks is not None:
            self.add_blocks(out, blocks)
        return out

    def add_blocks(self, C: PETSc.Mat, blocks: Array) -> None:
        """Add a block per body to a reduced matrix and complete it. Collective.

        They have the shape (bodies, 6 + m, 6 + m), equal on all ranks.
        """
        own = blocks[self._own_bodies]
        values = own.reshape(-1) if self._alike else own[self._own_entries]
        C.setValuesIJV(*self._own_csr, values, PETSc.InsertMode.ADD_VALUES, self._own_rows)
        C.assemble()


def _owners(layout: DofLayout, comm: MPI.Intracomm) -> Ints:
    """Rank that owns the unknowns of each body: the first with most of its attached nodes."""
    counts = comm.allgather([len(attached) for attached in layout.attached])
    return np.argmax(np.reshape(counts, (comm.size, -1)), axis=0)

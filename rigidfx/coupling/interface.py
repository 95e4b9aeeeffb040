"""The cells at the interface of bodies: their matrix, once the nodes of a body move with it.

Lᵀ K P needs sums over the attached nodes of a body only where K meets L or P. There both are linear
in the arms x = [1, V] of a node, which never change: the rows of P are Σⱼ xⱼ Pⱼ with four matrices
of shape (3, 6) that turn with the body, see `Increments.P`. So

    Σ_a K_fa P_a = Σⱼ Mⱼ Pⱼ,    Mⱼ = Σ_a x_aj K_fa,

and likewise from the left: the *moments* M of the entries of K are one product with a constant
sparse matrix, the rest is as small as the number of nodes beside bodies. MatPtAP and (L - P)ᵀKP
give the same, but have to be told in every iteration that rows of P are alike: where nearly all
flexible cells are at an interface (369 unknowns), a step took 1.8 times that of the flexible cells alone,
with moments it takes 1.5 times that (`demos/benchmarks/condensation.py --rigid 0.99`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from petsc4py import PETSc
from scipy.sparse import csr_array

from rigidfx.coupling.prolongation import Prolongation

__all__ = ["Interface"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Nodes:
    """What becomes of the columns of K, ghosts included.

    Attributes:
        numbers: Unknown of each of a node's dofs, -1 if it is none, shape (nodes, 3).
        body: Body that moves the node, -1 if none.
        arms: [1, V] of nodes that a body moves, shape (nodes, 4) [1, m].
    """

    numbers: Ints
    body: Ints
    arms: Array

    @property
    def counts(self) -> npt.NDArray[np.bool_]:
        """Whether a node has to do with any unknown."""
        return (self.body >= 0) | (self.numbers >= 0).any(axis=1)


class Interface:
    """A bilinear form over the cells that touch bodies, condensed into a reduced matrix."""

    def __init__(self, prolongation: Prolongation, form: fem.Form, consistent: bool = True) -> None:
        """Find the pattern. Collective.

        Args:
            prolongation: Map between unknowns and dofs.
            form: The form over flexible cells that touch a body.
            consistent: Whether the test side is L and not P.
        """
        self._prolongation, self._form, self._consistent = prolongation, form, consistent
        self._K = fem.create_matrix(form)
        owned = self._K.index_map(0).size_local
        count = int(self._K.indptr[owned])
        row = np.repeat(np.arange(owned), np.diff(self._K.indptr[: owned + 1]))
        column = self._K.indices[:count].astype(np.int64)
        self._blocks = self._K.data[: 9 * count].reshape(-1, 9)
        self._sum_up(_nodes(prolongation, self._K.index_map(1)), row, column)

    def _sum_up(self, nodes: Nodes, row: Ints, column: Ints) -> None:
        """Find which blocks of K make up which moments, and where those go in the matrix."""
        counts = nodes.counts[row] & nodes.counts[column]
        by_row, by_column = nodes.body[row] >= 0, nodes.body[column] >= 0
        ff, fb, bf, bb = (
            np.flatnonzero(counts & (by_row == left) & (by_column == right))
            for left, right in ((0, 0), (0, 1), (1, 0), (1, 1))
        )
        # Pairs of a body and a row, or a column, sorted by bodies; within bodies, of two bodies and
        # a row. There moments are first about columns; those about rows too are sums of these.
        bodies = len(self._prolongation.body_columns)
        outer, at_outer = _pairs(nodes.body[column[fb]], row[fb])
        below, at_below = _pairs(nodes.body[row[bf]], column[bf])
        inner, at_inner = _pairs(nodes.body[row[bb]] * bodies + nodes.body[column[bb]], row[bb])
        self._moments = _stacked(
            (at_outer, fb, nodes.arms[column[fb]], outer[0].size),
            (at_below, bf, nodes.arms[row[bf]], below[0].size),
            (at_inner, bb, nodes.arms[column[bb]], inner[0].size),
            width=row.size,
        )
        self._ends = np.cumsum([4 * pairs[0].size for pairs in (outer, below)])
        self._outer, self._below = _spans(outer[0]), _spans(below[0])
        self._inner = [(span, nodes.arms[inner[1][span]].T.copy()) for _, span in _spans(inner[0])]
        met = np.stack(np.divmod(np.unique(inner[0]), bodies))
        self._met = [_selection(one, bodies) for one in met]
        self._double = np.empty((len(self._inner), 4, 36))
        # What makes the two 3×3 blocks of Σⱼ Mⱼ Pⱼ, or of Σⱼ Lⱼᵀ Mⱼ, from four Mⱼ, row by row;
        # and where in it P and L are.
        self._right, self._left = (np.zeros((bodies, 36, 18)) for _ in range(2))
        self._P = np.einsum("kjibsic->kijbsc", self._right.reshape(-1, 4, 3, 3, 2, 3, 3))
        self._L = np.einsum("kjbcsic->kcjbsi", self._left.reshape(-1, 4, 3, 3, 2, 3, 3))
        own = met.T
        # What goes into the matrix, block by block: K where no body is, rows of free nodes at a
        # body, the two rows of a body at free nodes, the blocks of bodies.
        self._ff = ff
        sizes = np.cumsum([ff.size, 2 * outer[0].size, 2 * below[0].size, 4 * len(own)])
        self._out = np.empty((sizes[-1], 3, 3))
        self._parts = np.split(self._out, sizes[:-1])
        number, six = nodes.numbers, _six(self._prolongation)
        self._locate(
            np.concatenate([
                number[row[ff]],
                np.repeat(number[outer[1]], 2, axis=0),
                six[below[0]].reshape(-1, 3),
                np.repeat(six[own[:, 0]], 2, axis=1).reshape(-1, 3),
            ]),
            np.concatenate([
                number[column[ff]],
                six[outer[0]].reshape(-1, 3),
                np.repeat(number[below[1]], 2, axis=0),
                np.tile(six[own[:, 1]], (1, 2, 1)).reshape(-1, 3),
            ]),
        )  # fmt: skip

    def _locate(self, row: Ints, column: Ints) -> None:
        """Where the 3×3 blocks go, by the unknowns of their rows and columns, -1 for none."""
        if self._prolongation.nodal:
            row, column = row[:, 0] // 3, column[:, 0] // 3
        else:
            row, column = np.repeat(row.reshape(-1), 3), np.repeat(column, 3, axis=0).reshape(-1)
        begins = np.flatnonzero(np.diff(row, prepend=-2))  # PETSc is told of a row once in a run
        self._row_numbers = row[begins].astype(PETSc.IntType)
        self._offsets = np.r_[begins, row.size].astype(PETSc.IntType)
        self._columns = column.astype(PETSc.IntType)

    def assemble(self) -> None:
        """Assemble K anew. Collective."""
        self._K.set_value(0.0)
        fem.assemble_matrix(self._K, self._form)
        if self._prolongation.comm.size > 1:
            self._K.scatter_reverse()

    def add(self, other: Interface, factor: float) -> None:
        """Add a multiple of another K of the same cells."""
        self._K.data[:] += factor * other._K.data

    def insert_into(self, matrix: PETSc.Mat) -> None:
        """Add Lᵀ K P to a reduced matrix that is not assembled yet. Collective."""
        self._condense()
        nodal = self._prolongation.nodal
        add = matrix.setValuesBlockedIJV if nodal else matrix.setValuesIJV
        add(
            self._offsets,
            self._columns,
            self._out.reshape(-1),
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=self._row_numbers,
        )

    def _condense(self) -> None:
        """Set the blocks of Lᵀ K P."""
        trial = self._prolongation.increments.P
        test = self._prolongation.increments.L if self._consistent else trial
        plain, outer, below, own = self._parts
        np.take(self._blocks, self._ff, axis=0, out=plain.reshape(-1, 9), mode="clip")
        sums = self._moments @ self._blocks
        begin, end = self._ends
        self._P[:] = trial.reshape(-1, 1, 4, 3, 2, 3)
        self._L[:] = test.reshape(-1, 1, 4, 3, 2, 3)
        self._turn(sums[:begin], self._outer, self._right, outer)
        self._turn(sums[begin:end], self._below, self._left, below)
        moments = sums[end:].reshape(-1, 36)
        for double, (span, arms) in zip(self._double, self._inner, strict=True):
            np.matmul(arms, moments[span], out=double)
        K = self._double.reshape(-1, 4, 4, 3, 3).swapaxes(2, 3).reshape(-1, 12, 12)
        six = test[self._met[0]].swapaxes(1, 2) @ K @ trial[self._met[1]]
        own.reshape(-1, 2, 2, 3, 3)[:] = six.reshape(-1, 2, 3, 2, 3).swapaxes(2, 3)

    @staticmethod
    def _turn(sums: Array, spans: list[tuple[int, slice]], maker: Array, out: Array) -> None:
        """Two blocks from each four moments of a node beside a body."""
        moments, two = sums.reshape(-1, 36), out.reshape(-1, 18)
        for k, span in spans:
            np.matmul(moments[span], maker[k], out=two[span])


def _pairs(bodies: Ints, nodes: Ints) -> tuple[tuple[Ints, Ints], Ints]:
    """Pairs of a body and a node, each once and sorted, and which of them the given ones are."""
    count = int(nodes.max(initial=0)) + 1
    keys, places = np.unique(bodies * count + nodes, return_inverse=True)
    return (keys // count, keys % count), places.reshape(-1)


def _selection(bodies: Ints, count: int) -> Ints | slice:
    """What takes these bodies out of so many: nothing is copied where they are all."""
    return slice(None) if np.array_equal(bodies, np.arange(count)) else bodies


def _spans(bodies: Ints) -> list[tuple[int, slice]]:
    """Where each body is in a sorted list of bodies."""
    each, begins = np.unique(bodies, return_index=True)
    ends = np.append(begins, bodies.size)[1:]
    return [(int(k), slice(i, j)) for k, i, j in zip(each, begins, ends, strict=True)]


def _stacked(*sums: tuple[Ints, Ints, Array, int], width: int) -> csr_array:
    """A matrix that takes weighted sums, four of each.

    Args:
        sums: Which sum a term goes to, which term it is, its four weights; the number of sums.
        width: Number of all terms.
    """
    rows, columns, weights, begin = [], [], [], 0
    for place, term, weight, count in sums:
        rows.append((begin + 4 * place[:, None] + np.arange(4)).reshape(-1))
        columns.append(np.repeat(term, 4))
        weights.append(weight.reshape(-1))
        begin += 4 * count
    where = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(weights), where), shape=(begin, width))


def _six(prolongation: Prolongation) -> Ints:
    """The unknowns of bodies, those of translation and of rotation, shape (bodies, 2, 3)."""
    first = np.asarray(prolongation.body_columns, dtype=np.int64)
    return first[:, None, None] + np.arange(6).reshape(2, 3)


def _nodes(prolongation: Prolongation, columns: object) -> Nodes:
    """What becomes of the columns of a matrix, which may have more ghosts than the mesh."""
    info = la.vector(columns, 7)
    part, own = prolongation.layout, info.array.reshape(-1, 7)
    own[:, :4] = -1.0
    dofs = part.rows.dofs[prolongation.free]
    own[dofs // 3, dofs % 3] = prolongation.first_column + np.arange(dofs.size)
    for k, (body, at) in enumerate(zip(part.bodies, part.attached, strict=True)):
        own[body.nodes[at], 3] = k
        own[body.nodes[at], 4:] = body.offsets[at]
    info.scatter_forward()
    arms = np.c_[np.ones(own.shape[0]), own[:, 4:]]
    return Nodes(own[:, :3].astype(np.int64), own[:, 3].astype(np.int64), arms)

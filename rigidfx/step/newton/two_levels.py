"""GMRES with incomplete factors and a coarse grid: docs/theory/step.md#a-coarse-grid.

Of z_c = P (Pᵀ A P)⁻¹ Pᵀ r, z = z_c + M⁻¹ (r - A z_c), A P is known, so that the product A z_c costs
a fifth of one with A. PETSc's PCMG of type kaskade is the same with another product with A.
"""

from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from rigidfx.base.matrices import distributed, free
from rigidfx.base.types import Array, Bools, Ints
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.linear.linear_solver import configure
from rigidfx.mechanics.rigid_motions import rigid_motions
from rigidfx.step.equations.equations import Equations
from rigidfx.step.newton.factors import OF_INCOMPLETE, IncompleteFactors

COARSE = OF_INCOMPLETE + "coarse_"  # prefix of the coarse solver's options
NODES = 260  # of an aggregate, at most
EMPTY = 1e-12  # squared norm of a motion that nothing takes part in, relative to the largest


class Aggregates:
    """The aggregates of a layout.

    Smoothing leaves errors that hardly strain over some cells. A coarse problem has to represent
    them, here by motions in which each aggregate moves like a rigid body (R. A. Nicolaides,
    doi:10.1137/0724027, takes constants). Aggregates are the leaves of a k-d tree of this rank's
    nodes, boxes with about equal numbers of nodes; each rigid body is an aggregate.
    """

    def __init__(self, prolongation: Prolongation) -> None:
        """Divide the nodes. Collective."""
        self._prolongation = prolongation
        self._free = prolongation.free_of_nodes
        leaf = _leaves(prolongation.at_nodes(prolongation.layout.rows.X), NODES)
        self._order = np.argsort(leaf, kind="stable")
        self._leaf = leaf
        self._starts = np.flatnonzero(np.diff(leaf[self._order], prepend=-1))

    def motions(self, x: Array) -> PETSc.Mat:
        """Their rigid motions, orthonormal, as a new matrix that the caller destroys. Collective.

        It has a row for each unknown, and six columns for each aggregate, fewer where supports
        leave none of some of its motions. Positions of the active nodes are x, (nodes, 3) [m].
        """
        B, kept = self._orthonormal(self._prolongation.at_nodes(x))
        numbers = np.cumsum(kept).reshape(kept.shape) - 1
        of_node = kept[self._leaf]
        taken = self._free[:, :, None] & of_node[:, None, :]
        columns = np.broadcast_to(numbers[self._leaf][:, None, :], B.shape)[taken]
        lengths = np.broadcast_to(of_node.sum(axis=1)[:, None], self._free.shape)[self._free]
        count = int(kept.sum())
        own = self._prolongation.owned - self._prolongation.own_free
        lengths = np.r_[lengths, np.ones(own, dtype=np.int64)]
        columns = np.r_[columns, count + np.arange(own)]
        values = np.r_[B[taken], np.ones(own)]
        comm = self._prolongation.comm
        columns += comm.exscan(count + own) or 0
        shape = self._prolongation.owned, int(columns.max(initial=-1)) + 1
        rows = csr_array((values, columns, np.r_[0, np.cumsum(lengths)]), shape=shape)
        return distributed(rows, [(shape[0], None), (count + own, None)], comm)

    def _orthonormal(self, x: Array) -> tuple[Array, Bools]:
        """Motions of each node with its aggregate, (nodes, 3, 6), and which an aggregate has."""
        leaf, count = self._leaf, np.diff(np.r_[self._starts, len(self._leaf)])
        middle = self._summed(x) / count[:, None]
        arms = x - middle[leaf]
        length = np.sqrt(self._summed((arms**2).sum(axis=1)) / count)
        B = rigid_motions(arms, np.where(length > 0, length, 1.0)[leaf, None])
        B *= self._free[:, :, None]
        squares, vectors = np.linalg.eigh(self._summed(B.swapaxes(1, 2) @ B))
        kept = squares > EMPTY * squares[:, -1:]
        vectors /= np.sqrt(np.where(kept, squares, np.inf))[:, None, :]
        return B @ vectors[leaf], kept

    def _summed(self, values: Array) -> Array:
        """Sums over the nodes of each aggregate."""
        if not self._starts.size:
            return np.zeros((0, *values.shape[1:]))
        return np.asarray(np.add.reduceat(values[self._order], self._starts))


def _leaves(X: Array, size: int) -> Ints:
    """The number of the leaf of each point; a leaf has at most `size` of them."""
    leaf = np.zeros(len(X), dtype=np.int64)
    if not len(X):
        return leaf
    tree = cKDTree(X, leafsize=size)
    nodes, count = [tree.tree], 0
    while nodes:
        node = nodes.pop()
        if node.lesser is None:
            leaf[tree.indices[node.start_idx : node.end_idx]] = count
            count += 1
        else:
            nodes += [node.lesser, node.greater]
    return leaf


class CoarseGrid:
    """A preconditioner of PETSc's in Python: a coarse correction, then that of another one."""

    def __init__(self, equations: Any, fine: PETSc.PC) -> None:
        """Divide the nodes into aggregates; `fine` is the other preconditioner. Collective.

        The equations have a `tangent_matrix`, a `prolongation`, and `positions` of nodes.
        """
        self.fine = fine
        self._equations = equations
        self._aggregates = Aggregates(equations.prolongation)
        self._left = equations.prolongation.unknowns()
        self._grid: list[PETSc.Object] = []  # all that belongs to one tangent

    def setUp(self, pc: PETSc.PC) -> None:
        """PETSc's call: make both of a new tangent. Collective."""
        A = self._equations.tangent_matrix
        self.fine.setOperators(A)
        self.fine.setUp()
        self._free()
        self._P = self._aggregates.motions(self._equations.positions)
        # In the only format in which products can be made.
        rows = A.convert(PETSc.Mat.Type.AIJ, out=PETSc.Mat())
        self._image = rows.matMult(self._P)
        rows.destroy()
        coarse = self._P.transposeMatMult(self._image)
        self._motion, self._resultant = coarse.createVecs()
        self._coarse = PETSc.KSP().create(coarse.comm)
        self._coarse.setOptionsPrefix(COARSE)
        configure(self._coarse, True, coarse.size[0], False)
        self._coarse.setOperators(coarse)
        self._coarse.setUp()
        self._grid = [self._P, self._image, coarse, self._motion, self._resultant, self._coarse]

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """PETSc's call: z of the module's text. Collective."""
        self._P.multTranspose(r, self._resultant)
        self._coarse.solve(self._resultant, self._motion)
        self._image.mult(self._motion, self._left)
        self._left.aypx(-1.0, r)
        self.fine.apply(self._left, z)
        self._P.multAdd(self._motion, z, z)

    def _free(self) -> None:
        free(*self._grid)
        self._grid.clear()

    def destroy(self, pc: PETSc.PC) -> None:
        """PETSc's call: free both. Collective."""
        self._free()
        free(self.fine, self._left)


class TwoLevels(IncompleteFactors):
    """As `IncompleteFactors`, with a coarse grid; `destroy` frees it."""

    def __init__(self, equations: Equations) -> None:
        """Create the solver for the tangent of some equations. Collective."""
        super().__init__(equations)
        # The factors stay as they are, and as PETSc's options would have them.
        self._grid = CoarseGrid(equations, self._ksp.getPC())
        both = PETSc.PC().create(self._ksp.comm)
        both.setType(PETSc.PC.Type.PYTHON)
        both.setPythonContext(self._grid)
        both.setOperators(equations.tangent_matrix)
        self._ksp.setPC(both)
        both.destroy()  # the solver has it

    @property
    def name(self) -> str:
        """Its name in reports."""
        return f"{self._ksp.getType()}+{self._grid.fine.getType()}+coarse"

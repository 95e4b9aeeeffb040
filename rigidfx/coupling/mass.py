"""The mass operator: lumped or consistent. Point masses at nodes are diagonal in both.

It acts on PETSc vectors over some of the nodes and adds itself to a condensed tangent. A run uses
one kind throughout: mixing them breaks the conservation of angular momentum.

Masses at points of faces are Σ Jᵀ m J, with J the derivatives of a point by the nodes of its face,
and take part where all of these nodes do. A reduced tangent gets nothing of them here: with steps
they are a stiffness at ports, see `rigidfx.effects.attached.point_mass`.
"""

from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, hstack, vstack

from rigidfx.base.matrices import distributed, free
from rigidfx.base.types import Array, Bools, Indices, Ints
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import PointMass
from rigidfx.effects.joints.vectors import Vector, slopes_of
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.kernels import Kernel
from rigidfx.scene.scene import Scene


class Mass:
    """M of the cells, or lumped at nodes, with point masses; `destroy` frees it."""

    def __init__(
        self,
        scene: Scene,
        rows: Rows,
        cells: Cells,
        own: Bools,
        driven: Cells | None = None,
        carried: bool = False,
    ) -> None:
        """Assemble the matrix once. Collective.

        Args:
            scene: The problem.
            rows: Those of the nodes it acts on.
            cells: Owned cells by subdomain id whose mass counts, if it is consistent.
            own: For each of the nodes, whether lumped and point masses count here.
            driven: Owned cells that a support moves; their mass counts too, but not in tangents.
            carried: Whether point masses count that are bodies of their own in a run.
        """
        self._rows, lumped = rows, scene.mass == "lumped"
        masses = scene.nodal_mass if lumped else scene.point_masses
        self._diagonal = rows.vector()
        self._diagonal.array[:] = np.repeat(np.where(own, masses[rows.nodes], 0.0), 3)
        self._reduced: PETSc.Vec | None = None
        self._condensed: CondensedMatrix | None = None
        self._scene, self._cells, self._lumped = scene, cells, lumped
        self._matrix = self._assembled(driven)
        self._faces, self._slopes = _at_faces(scene, rows, own, carried)

    def _assembled(self, driven: Cells | None) -> PETSc.Mat:
        """M but for masses at points of faces: that of one direction, thrice. Collective."""
        rows, n = self._rows, self._rows.nodes.size
        first, count = rows.first // 3, rows.comm.allreduce(n)
        places = np.arange(n), first + np.arange(n)
        M = csr_array((self._diagonal.array_r[::3], places), shape=(n, count))
        if not self._lumped:
            cells = self._cells
            if driven is not None:
                cells = {i: np.union1d(own, driven[i]) for i, own in cells.items()}
            M = csr_array(M + _of_one_direction(self._scene, cells, rows.nodes, first, count))
        of_rows = M[np.repeat(places[0], 3)]
        axes = np.repeat(np.tile(np.arange(3), n), np.diff(of_rows.indptr))
        entries = of_rows.data, 3 * of_rows.indices + axes, of_rows.indptr
        every = csr_array(entries, shape=(3 * n, 3 * count))
        every.sort_indices()
        return distributed(every, [self._diagonal.sizes] * 2, rows.comm)

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v. Collective."""
        self._matrix.mult(v, out)
        if self.at_points:
            out.array[:] += self.of_points(v.array_r)

    @property
    def at_points(self) -> bool:
        """Whether there are masses at points of faces."""
        return self._faces.size > 0

    def of_points(self, v: Array) -> Array:
        """The part of M v by masses at points of faces, shape (rows,). Collective."""
        moved = np.asarray(self._slopes @ v)
        self._rows.comm.Allreduce(MPI.IN_PLACE, moved)
        return np.asarray(self._slopes.T @ (self._faces * moved))

    def of_directions(self, at: Ints, values: Array) -> Array:
        """The rest of it, alike in all directions, at places of nodes in the rows. Collective.

        Columns have values at these, zero at others; both have the shape (nodes, k).
        """
        if self._lumped:
            return np.asarray(self._diagonal.array_r[3 * at, None] * values)
        out, a, b = np.empty_like(values), self._rows.vector(), self._rows.vector()
        a.set(0.0)
        for k, column in enumerate(values.T):
            a.array[3 * at] = column
            self._matrix.mult(a, b)
            out[:, k] = b.array_r[3 * at]
        a.destroy()
        b.destroy()
        return out

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M of flexible cells and nodes to a tangent that is not finished. Collective.

        Masses at points of faces are not added: see the module.
        """
        if self._lumped:
            tangent.matrix.assemble()
            self._add_diagonal(tangent.matrix, factor, prolongation)
            return
        if self._condensed is None:
            part = prolongation.layout
            dealt = None if prolongation.dealt is None else prolongation.dealt.cells
            kernel = _kernel_of(self._scene, self._scene.space, self._cells)
            forms = [kernel.bind(own, dealt=dealt) for own in (part.interior, part.interface)]
            self._condensed = CondensedMatrix(prolongation, *forms)
            self._condensed.assemble()
            self._condensed.matrix.assemble()
            self._add_diagonal(self._condensed.matrix, 1.0, prolongation)
        tangent.add(self._condensed, factor)

    def _add_diagonal(self, A: PETSc.Mat, factor: float, prolongation: Prolongation) -> None:
        """Add a multiple of the free dofs' diagonal to an assembled reduced matrix. Collective."""
        if self._reduced is None:
            self._reduced = prolongation.unknowns()
        prolongation.collapse(self._diagonal.array_r, prolongation.no_bodies, self._reduced)
        self._reduced.scale(factor)
        A.setDiagonal(self._reduced, PETSc.InsertMode.ADD_VALUES)

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it. Collective."""
        M, comm = self._matrix.copy(), self._rows.comm
        if self._faces.size:
            every = hstack(comm.allgather(self._slopes), format="csr")
            added = csr_array((self._slopes.T * self._faces) @ every)
            more = distributed(added, M.getSizes(), comm)
            M.axpy(1.0, more, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            more.destroy()
        return M

    def reduced(self, p: Prolongation, blocks: Array) -> PETSc.Mat:
        """Pᵀ M P with blocks of the bodies, as a new matrix; the caller destroys it. Collective."""
        M = self.matrix()
        out = p.condense(M, blocks)
        M.destroy()
        return out

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        free(self._matrix, self._diagonal, self._reduced, self._condensed)


def _at_faces(scene: Scene, rows: Rows, own: Bools, carried: bool) -> tuple[Array, csr_array]:
    """Masses at points of faces all of whose nodes count, three times each, and J. Collective."""
    masses: list[float] = []
    slopes: list[csr_array] = []
    for effect in scene.named(PointMass):
        if effect.face is not None and (carried or not effect.is_carried):
            of_point = _slopes(scene, effect.remote.place, rows, own)
            if of_point is not None:
                masses.append(float(effect.mass))
                slopes.append(of_point)
    none = csr_array((0, rows.dofs.size))
    return np.repeat(masses, 3), csr_array(vstack([none, *slopes], format="csr"))


def _slopes(scene: Scene, vector: Vector, rows: Rows, counted: Bools) -> csr_array | None:
    """Derivatives of a vector by rows at the start, shape (3, rows). Collective.

    None if some of its nodes do not count.
    """
    nodes, slopes = vector.nodes, slopes_of(vector)
    at = np.searchsorted(rows.nodes, nodes)
    at[at == rows.nodes.size] = 0
    here = rows.nodes[at] == nodes if rows.nodes.size else np.zeros(at.size, dtype=bool)
    here &= counted[at] if rows.nodes.size else False
    if scene.sum(np.count_nonzero(~here)) > 0:
        return None
    columns = np.broadcast_to(3 * at[:, None, None] + np.arange(3), slopes.shape)
    row = np.broadcast_to(np.arange(3)[:, None], slopes.shape)
    return csr_array((slopes.ravel(), (row.ravel(), columns.ravel())), (3, rows.dofs.size))


def _kernel_of(scene: Scene, space: Any, cells: Cells) -> Kernel:
    """∫ ρ0 v·w dV of some cells. Collective."""
    v, w = ufl.TrialFunction(space), ufl.TestFunction(space)
    degree = {"quadrature_degree": 2 * scene.order + 2}
    dx = ufl.Measure("dx", domain=scene.mesh, metadata=degree)
    form = scene.density() * ufl.inner(v, w) * dx(tuple(cells))
    return Kernel(form, [space] * 2, scene.mesh)


def _of_one_direction(
    scene: Scene, cells: Cells, nodes: Indices, first: int, count: int
) -> csr_array:
    """The mass matrix of cells in one direction. Collective.

    Rows are owned nodes of this rank; columns are those of all ranks, `count`, of which this rank's
    begin at `first`. Entries of other nodes are left out.
    """
    space, node_of = scene.component
    form = _kernel_of(scene, space, cells).bind(cells)
    A = fem.create_matrix(form)
    fem.assemble_matrix(A, form)
    A.scatter_reverse()
    dof_of = np.empty_like(node_of)
    dof_of[node_of] = np.arange(node_of.size)
    own, numbers = dof_of[nodes], la.vector(A.index_map(1))
    numbers.array[:] = count
    numbers.array[own] = first + np.arange(own.size)
    numbers.scatter_forward()
    M = A.to_scipy()[own]
    at = numbers.array.astype(np.int64)[M.indices]
    return csr_array((M.data, at, M.indptr), shape=(own.size, count + 1))[:, :count]

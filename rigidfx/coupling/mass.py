"""The two mass operators: diagonal, and consistent. Point masses at nodes are diagonal in both.

Both act on PETSc vectors over some of the nodes and add themselves to a condensed tangent. A run
uses one of them throughout: mixing them breaks the conservation of angular momentum.

Masses at points of faces are Σ Jᵀ m J, with J the derivatives of a point by the nodes of its face,
and take part where all of these nodes do. A reduced tangent gets nothing of them here: with steps
they are a stiffness at ports, see `rigidfx.effects.attached.point_mass`.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import ufl
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import block_diag, csr_array, csr_matrix, hstack, vstack

from rigidfx.base.types import Array, Bools
from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.coupling.rows import Rows
from rigidfx.effects import PointMass
from rigidfx.effects.joints.averages import Vector
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.kernels import Kernel
from rigidfx.scene.scene import Scene


class WithRemoteMasses:
    """A mass operator with masses at points of faces."""

    def __init__(self, within: Any, rows: Rows, masses: Array, slopes: csr_array) -> None:
        """Keep them.

        Args:
            within: The mass operator of cells and nodes.
            rows: The rows it acts on.
            masses: The masses [kg].
            slopes: J of each, shape (3 · masses, 3 · nodes of the rows).
        """
        self._within, self._rows = within, rows
        self._masses, self._slopes = masses, slopes

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v. Collective."""
        self._within.mult(v, out)
        moved = np.asarray(self._slopes @ v.array_r)
        self._rows.comm.Allreduce(MPI.IN_PLACE, moved)
        out.array[:] += self._slopes.T @ (np.repeat(self._masses, 3) * moved)

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M but for these masses. Collective."""
        self._within.add_to(tangent, factor, prolongation)

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it. Collective."""
        M = self._within.matrix()
        blocks = self._masses[:, None, None] * np.eye(3)
        add_at_vectors(M, self._slopes, blocks, self._rows.comm)
        return M

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        self._within.destroy()


def with_remote_masses(
    scene: Scene, mass: Any, rows: Rows, counted: Bools, carried: bool = False
) -> Any:
    """A mass operator with the masses at points of faces all of whose nodes count. Collective.

    Args:
        scene: The problem.
        mass: The operator of cells and nodes.
        rows: The rows it acts on.
        counted: For each node of the rows, whether it counts.
        carried: Whether masses count that are bodies of their own in a run.
    """
    masses: list[float] = []
    slopes: list[csr_array] = []
    for effect in (e for e in scene.named(PointMass) if e.face is not None):
        if effect.is_carried and not carried:
            continue
        own = slopes_of(scene, effect.remote.place, rows, counted)
        if own is not None:
            masses.append(float(effect.mass))
            slopes.append(own)
    if not masses:
        return mass
    return WithRemoteMasses(mass, rows, np.array(masses), csr_array(vstack(slopes, format="csr")))


def slopes_of(scene: Scene, vector: Vector, rows: Rows, counted: Bools) -> csr_array | None:
    """Derivatives of a vector by nodes at the start; None if some do not count. Collective.

    Args:
        scene: The problem.
        vector: The vector.
        rows: The rows in question.
        counted: For each node of the rows, whether it counts.

    Returns:
        Shape (3, 3 · nodes of the rows).
    """
    nodes, slopes = vector.nodes, vector.slopes()
    at = np.searchsorted(rows.nodes, nodes)
    at[at == rows.nodes.size] = 0
    here = rows.nodes[at] == nodes if rows.nodes.size else np.zeros(at.size, dtype=bool)
    here &= counted[at] if rows.nodes.size else False
    if scene.sum(np.count_nonzero(~here)) > 0:
        return None
    columns = np.broadcast_to(3 * at[:, None, None] + np.arange(3), slopes.shape)
    row = np.broadcast_to(np.arange(3)[:, None], slopes.shape)
    return csr_array((slopes.ravel(), (row.ravel(), columns.ravel())), (3, 3 * rows.nodes.size))


def add_at_vectors(A: PETSc.Mat, slopes: csr_array, blocks: Array, comm: MPI.Intracomm) -> None:
    """Add Σ Jᵀ B J to a matrix, whose pattern grows. Collective.

    Args:
        A: The matrix of some rows.
        slopes: J of each vector, shape (3 · vectors, 3 · nodes of the rows).
        blocks: B of each, shape (vectors, 3, 3).
        comm: The ranks.
    """
    every = hstack(comm.allgather(slopes), format="csr")
    B, kind = block_diag([csr_array(block) for block in blocks]), PETSc.IntType
    added = csr_array(slopes.T @ B @ every)
    csr = added.indptr.astype(kind), added.indices.astype(kind), added.data
    more = PETSc.Mat().createAIJ(A.getSizes(), csr=csr, comm=comm)
    A.axpy(1.0, more, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    more.destroy()


class Mass(Protocol):
    """A mass operator."""

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v."""
        ...

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M to an assembled tangent that is not finished yet. Collective."""
        ...

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it."""
        ...

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        ...


class LumpedMass:
    """Diagonal mass: one number per node, three times; none at nodes that bodies hold."""

    def __init__(self, rows: Rows, masses: Array) -> None:
        """Keep nodal masses.

        Args:
            rows: Those of the nodes that count here.
            masses: Mass of each [kg].
        """
        self._diagonal = rows.vector()
        self._diagonal.array[:] = np.repeat(masses, 3)
        self._reduced: PETSc.Vec | None = None

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v."""
        out.pointwiseMult(self._diagonal, v)

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M at the free dofs. Collective."""
        if self._reduced is None:
            self._reduced = prolongation.unknowns()
        tangent.matrix.assemble()
        _add_diagonal(tangent.matrix, factor, self._diagonal, prolongation, self._reduced)

    def matrix(self) -> PETSc.Mat:
        """M as a new AIJ matrix; the caller destroys it."""
        M = PETSc.Mat().createAIJ([self._diagonal.sizes] * 2, nnz=1, comm=self._diagonal.comm)
        M.setDiagonal(self._diagonal)
        M.assemble()
        return M

    def destroy(self) -> None:
        """Free the diagonal. Collective."""
        for vector in (self._diagonal, self._reduced):
            if vector is not None:
                vector.destroy()


def _add_diagonal(
    A: PETSc.Mat,
    factor: float,
    diagonal: PETSc.Vec,
    prolongation: Prolongation,
    reduced: PETSc.Vec,
) -> None:
    """Add a multiple of the free dofs' diagonal to an assembled reduced matrix. Collective."""
    prolongation.collapse(diagonal.array_r, prolongation.no_bodies, reduced)
    reduced.scale(factor)
    A.setDiagonal(reduced, PETSc.InsertMode.ADD_VALUES)


class ConsistentMass:
    """M = ∫ ρ0 Nᵢ Nⱼ dV over the given cells, and point masses."""

    def __init__(
        self,
        scene: Scene,
        rows: Rows,
        cells: Cells,
        driven: Cells | None = None,
        points: Array | None = None,
    ) -> None:
        """Assemble the matrix once. Collective.

        Args:
            scene: The problem.
            rows: Those of the nodes of the cells.
            cells: Flexible cells: the addition to tangents.
            driven: Further cells whose dofs are all prescribed: they count in products with
                vectors.
            points: Point mass of each of the nodes [kg]; none if None.
        """
        v, w = ufl.TrialFunction(scene.space), ufl.TestFunction(scene.space)
        dx = ufl.Measure(
            "dx", domain=scene.mesh, metadata={"quadrature_degree": 2 * scene.order + 2}
        )
        form = scene.density() * ufl.inner(v, w) * dx(tuple(cells))
        self._kernel = Kernel(form, [scene.space] * 2, scene.mesh)
        counted = cells
        if driven is not None:
            counted = {i: np.union1d(own, driven[i]) for i, own in cells.items()}
        bound = self._kernel.bind(counted)
        self._matrix = rows.matrix(bound)
        fem_petsc.assemble_matrix(self._matrix, bound)
        self._points: PETSc.Vec | None = None
        if points is not None and scene.sum(np.count_nonzero(points)) > 0:
            self._points = rows.vector()
            self._points.array[:] = np.repeat(points, 3)
            # A node of no counted cell has no entry in the pattern yet.
            rows.add_diagonal(self._matrix, self._points.array_r)
        self._matrix.assemble()
        self._matrix = without_zeros(self._matrix)
        self._condensed: CondensedMatrix | None = None

    def mult(self, v: PETSc.Vec, out: PETSc.Vec) -> None:
        """Evaluate out = M v."""
        self._matrix.mult(v, out)

    def add_to(self, tangent: CondensedMatrix, factor: float, prolongation: Prolongation) -> None:
        """Add factor · M of the flexible cells. Collective."""
        if self._condensed is None:
            part = prolongation.layout
            dealt = None if prolongation.dealt is None else prolongation.dealt.cells
            forms = [
                self._kernel.bind(cells, dealt=dealt) for cells in (part.interior, part.interface)
            ]
            self._condensed = CondensedMatrix(prolongation, *forms)
            self._condensed.assemble()
            self._condensed.matrix.assemble()
            if self._points is not None:
                reduced = prolongation.unknowns()
                _add_diagonal(self._condensed.matrix, 1.0, self._points, prolongation, reduced)
                reduced.destroy()
        tangent.add(self._condensed, factor)

    def matrix(self) -> PETSc.Mat:
        """A copy of M; the caller destroys it."""
        return self._matrix.copy()

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self._matrix.destroy()
        if self._points is not None:
            self._points.destroy()
        if self._condensed is not None:
            self._condensed.destroy()


def without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """A matrix of the nonzero entries of another, which is destroyed. Collective.

    A matrix that does not couple directions, as masses, has two zeros in three assembled entries.
    """
    rows, columns = A.getSizes()
    offsets, places, values = A.getValuesCSR()
    csr = csr_matrix((values, places, offsets), shape=(rows[0], columns[1]))
    csr.eliminate_zeros()
    B = PETSc.Mat().createAIJ([rows, columns], csr=(csr.indptr, csr.indices, csr.data), comm=A.comm)
    A.destroy()
    return B


def mass_operator(
    scene: Scene,
    rows: Rows,
    cells: Cells,
    own: Bools,
    driven: Cells | None = None,
    carried: bool = False,
) -> Mass:
    """The mass operator that a scene asks for.

    Args:
        scene: The problem.
        rows: Those of the nodes it acts on.
        cells: Owned cells by subdomain id whose mass counts, if it is consistent.
        own: For each of the nodes, whether lumped and point masses count here.
        driven: Owned cells that a support moves; their mass counts too.
        carried: Whether point masses count that are bodies of their own in a run.
    """
    mass: Mass
    if scene.mass == "lumped":
        mass = LumpedMass(rows, np.where(own, scene.nodal_mass[rows.nodes], 0.0))
    else:
        points = np.where(own, scene.point_masses[rows.nodes], 0.0)
        mass = ConsistentMass(scene, rows, cells, driven, points)
    operator: Mass = with_remote_masses(scene, mass, rows, own, carried)
    return operator

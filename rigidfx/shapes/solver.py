"""The stiffness of a structure, factored once for many right sides."""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.errors import SceneError
from rigidfx.base.types import Array
from rigidfx.coupling.rows import product
from rigidfx.linear.linear_solver import solver_of
from rigidfx.mechanics.rigid_motions import determining
from rigidfx.scene.scene import Scene
from rigidfx.shapes.iterative import conjugate_gradients
from rigidfx.shapes.stiffness import Stiffness, times

# Part of forces that a solve may leave. More is left where K is singular, or slender parts make
# rounding of K u large; then a correction by the rest is below √SOLVED where K is not singular.
SOLVED = 1e-6
# Bytes of factors, as estimated; a plate of a million unknowns is below, and took 2.7e9.
LARGEST_FACTORS = 4e9
UNSTABLE = (
    "Reduced: the structure is not stable in its present state, its stiffness is not definite: it "
    "buckles, or a part hangs by a line or a point of others. Reduce it in a state before the "
    "limit load, or leave the part flexible."
)


class Solver:
    """K⁻¹ with some rows pinned that determine the motions without stiffness."""

    def __init__(self, stiffness: Stiffness, motions: Array, stiffened: bool) -> None:
        """Factor by motions without stiffness, shape (owned nodes, 3, n). Collective.

        They are stiffened by springs, and by stresses that turn with the state. `SceneError` on
        every rank, if the rest is not definite.
        """
        self._of, p = stiffness, stiffness.prolongation
        self._pins = determining(stiffness.unknowns_of(motions), p.comm)
        self._count = motions.shape[2]  # of pins on all ranks
        self._K = stiffness.matrix
        K = self._K.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        diagonal = K.getDiagonal()
        scale = float(diagonal.norm()) / np.sqrt(p.size)
        diagonal.destroy()
        K.zeroRowsColumns((p.first_column + self._pins).astype(PETSc.IntType), diag=scale)
        if size_of_factors(stiffness.scene, p.size) > LARGEST_FACTORS:
            self._ksp = conjugate_gradients(K, p, stiffness.places[stiffness.structure.rows.nodes])
        else:
            self._ksp = solver_of(K)
            if not _definite(self._ksp):
                self._ksp.destroy()
                raise SceneError(UNSTABLE)
        self._stiffened = stiffened

    def balance(self, motions: Array, momenta: Array) -> None:
        """From now on inertia balances forces along R, RᵀMR = 1, by M R. Collective.

        R are some of the motions, or all, if nothing stiffens them, shape (owned nodes, 3, k).
        """
        self._motions = self._of.unknowns_of(motions)
        self._momenta = self._of.on_unknowns(momenta)
        if self._stiffened:
            self._border()

    def _border(self) -> None:
        """Find what pins and inertia along the motions do to displacements. Collective."""
        total, E = self._of.scene.sum, np.zeros((len(self._motions), self._count))
        first = self._of.prolongation.comm.exscan(self._pins.size) or 0
        E[self._pins, first + np.arange(self._pins.size)] = 1.0
        self._pinning, self._rows = E, np.c_[self._times(E), self._momenta]
        self._by = np.c_[E, np.zeros_like(self._momenta)] - self._solved(self._rows)
        self._bordered = np.asarray(total(self._rows.T @ self._by))
        self._bordered[: self._count, self._count :] += total(E.T @ self._momenta)

    def solve(self, F: Array) -> Array:
        """Displacements [m] by forces on nodes, orthogonal to the motions by mass. Collective.

        Of a stiffened K, [K, M R; RᵀM, 0] is solved by the factors and a small system for the pins.
        Forces are in balance with inertia; `SceneError` on every rank, if there are no such
        displacements.
        """
        right = self._of.on_unknowns(F)
        found, left = self._once(right)
        if not self._small(left, right, SOLVED):
            more, _ = self._once(left)
            if not self._small(more, found, np.sqrt(SOLVED)):
                raise SceneError(UNSTABLE)
            found += more
        return self._of.at_nodes(found)

    def _small(self, part: Array, whole: Array, ratio: float) -> bool:
        """Whether each column is at most so large beside that of the whole. Collective."""
        sizes = self._of.scene.sum(np.stack([(of**2).sum(axis=0) for of in (part, whole)]))
        return bool((sizes[0] <= ratio**2 * sizes[1]).all())

    def _once(self, right: Array) -> tuple[Array, Array]:
        """Unknowns by forces on them, and the forces that are left. Collective."""
        total, n = self._of.scene.sum, self._count
        found, left = self._solved(right), right
        if self._stiffened:
            wanted = -self._rows.T @ found
            wanted[:n] += self._pinning.T @ right
            small = np.linalg.solve(self._bordered, total(wanted))
            found += self._by @ small
            left = left - self._momenta @ small[n:]
        else:
            found -= self._motions @ total(self._momenta.T @ found)
        return found, left - self._times(found)

    def _times(self, y: Array) -> Array:
        return times(self._K, y, self._of.prolongation.unknowns)

    def _solved(self, right: Array) -> Array:
        """Unknowns by several right sides, both zero at pins. Collective."""
        p, right = self._of.prolongation, right.copy()
        right[self._pins] = 0.0
        return product(self._ksp.matSolve, right, p.comm)

    def destroy(self) -> None:
        """Free the factors. Collective."""
        self._ksp.destroy()


def size_of_factors(scene: Scene, unknowns: int) -> float:
    """Bytes that Cholesky's factors take in the order of nested dissection, to a factor of two.

    Of a box of a ≥ b ≥ c nodes and n = 3abc unknowns they have 9 n c (4 + log₂(b/c)) entries,
    fitted to bars, plates and blocks of 25 000 to 400 000. A structure counts as a box of its
    nodes with the two largest extents of its own. Collective.
    """
    x = scene.mesh.geometry.x
    ends = np.array([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
    scene.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    extent = np.sort(ends.sum(axis=0))
    nodes, cells = unknowns / 3, scene.mesh.topology.index_map(3).size_global
    spacing = scene.mean_cell_size * np.cbrt(cells / nodes)
    b, a = extent[1:] / spacing
    c = max(nodes / (a * b), 1.0)
    return float(8 * unknowns * 9 * c * (4 + np.log2(max(b / c, 1.0))))


def _definite(ksp: PETSc.KSP) -> bool:
    """Whether a factored matrix is positive definite; CHOLMOD has factored no other. Collective."""
    pc = ksp.getPC()
    if pc.getFailedReason():
        return False
    if pc.getFactorSolverType() != PETSc.Mat.SolverType.MUMPS:
        return True
    return int(pc.getFactorMatrix().getMumpsInfog(12)) == 0  # negative pivots

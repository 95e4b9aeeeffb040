"""The linear equations of motion of some rows about a shape, with springs to the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, vstack

from rigidfx.base.types import Array, Ints
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.remote_mass import WithRemoteMasses, add_at_vectors, slopes_of
from rigidfx.coupling.rows import Rows
from rigidfx.effects import Spring
from rigidfx.flexible.internal_forces import Cells
from rigidfx.flexible.linear_forms import LinearForms
from rigidfx.scene.scene import Scene
from rigidfx.step.linear.definite import solver_of
from rigidfx.step.linear.linear_solver import conjugate_gradients

__all__ = ["Ground", "LinearMotion", "ground_of", "step_kind"]

# Times its own stiffness that a part named rigid has besides: it strains by 1e-4 of what it would,
# and direct factors lose four digits of sixteen. With 1e3 a stalk that is rigid in its middle had
# ten times the error of u + e, 3.4e-4 of the motion, and e agreed on 1 and 2 ranks to 1e-9 of its
# size for 3e-8; u + e agreed to 1e-12 with both.
NAMED = 1e4
KINDS = 3  # of steps whose factors are kept: short, long and very long ones


@dataclass(frozen=True)
class Ground:
    """Ties of nodes, and of averages of nodes, to the ground.

    Attributes:
        K: Stiffness at nodes, shape (nodes, 3, 3) [N/m].
        C: Damping, of the same shape [N s/m].
        slopes: Derivatives of each point of a face by nodes, shape (3 · points, 3 · nodes).
        K_points: Stiffness there, shape (points, 3, 3) [N/m].
        C_points: Damping there, of the same shape [N s/m].
    """

    K: Array
    C: Array
    slopes: csr_array
    K_points: Array
    C_points: Array

    def add_to(self, rows: Rows, K: PETSc.Mat, C: PETSc.Mat) -> None:
        """Add stiffness and damping to matrices of all rows. Collective."""
        for A, nodal, points in ((K, self.K, self.K_points), (C, self.C, self.C_points)):
            rows.add_blocks(A, nodal)
            if len(points):
                add_at_vectors(A, self.slopes, points, rows.comm)

    def resistance(self, scene: Scene, motions: Array) -> Array:
        """Stiffness against some motions, shape (motions, motions). Collective.

        Args:
            scene: The problem.
            motions: Displacements of the owned nodes, shape (nodes, 3, motions) [m].
        """
        nodal = np.einsum("nik,nij,njl->kl", motions, self.K, motions)
        moved = np.asarray(scene.sum(self.slopes @ motions.reshape(-1, motions.shape[2])))
        moved = moved.reshape(-1, *motions.shape[1:])
        of_points = np.einsum("pik,pij,pjl->kl", moved, self.K_points, moved)
        return np.asarray(scene.sum(nodal)) + of_points


def ground_of(scene: Scene, rows: Rows) -> Ground | None:
    """The springs of a scene at all owned nodes; None if it has none. Collective."""
    springs = scene.named(Spring)
    if not springs:
        return None
    K, C = np.zeros((2, rows.nodes.size, 3, 3))
    at_points, slopes = [], [csr_array((0, 3 * rows.nodes.size))]
    counted = np.ones(rows.nodes.size, dtype=bool)
    for spring in springs:
        if spring.face is None:
            share = scene.shares(spring.where, spring.kind)[rows.nodes, None, None]
            K += share * spring.K
            C += share * spring.C
            continue
        own = slopes_of(scene, spring.remote.place, rows, counted)
        if own is not None:
            at_points.append((spring.K, spring.C))
            slopes.append(own)
    K_points, C_points = np.reshape(at_points, (-1, 2, 3, 3)).swapaxes(0, 1)
    return Ground(K, C, csr_array(vstack(slopes, format="csr")), K_points, C_points)


class LinearMotion:
    """M δ̈ + C δ̇ + K δ = ρ, with kept factors; `destroy` frees them."""

    def __init__(
        self,
        rows: Rows,
        cells: Cells,
        linear: LinearForms,
        mass: Mass,
        supported: Ints,
        ground: Ground | None = None,
        rigid: Cells | None = None,
        more: Sequence[PETSc.Mat] = (),
        stressed: bool = False,
    ) -> None:
        """Assemble the matrices. Collective.

        Args:
            rows: These rows.
            cells: Owned cells by subdomain id that strain.
            linear: Forms, whose shape is theirs.
            mass: Mass operator of the rows, owned from now on.
            supported: Rows of this rank that supports hold.
            ground: Forces of springs at the nodes, if there are any.
            rigid: Those of the cells that belong to parts named rigid.
            more: Masses besides, which are freed.
            stressed: Whether the stresses of the shape are part of the stiffness.
        """
        self._mass, self._first, self._supported = mass, rows.first, supported
        stiffness = linear.tangent(cells) if stressed else linear.stiffness(cells)
        self._K = rows.assembled(stiffness)
        if rigid is not None:
            stiff = rows.assembled(linear.stiffness(rigid))
            self._K.axpy(NAMED, stiff, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            stiff.destroy()
        self._M = mass.matrix()
        kinds, remote = PETSc.Mat.Structure, isinstance(mass, WithRemoteMasses)
        # A mass at a point of a face couples nodes that no cell does.
        self._pattern = kinds.DIFFERENT_NONZERO_PATTERN if remote else kinds.SUBSET_NONZERO_PATTERN
        for extra in more:
            self._M.axpy(1.0, extra, self._pattern)
            extra.destroy()
        viscosity = linear.viscosity(cells)
        self._viscosity = None if viscosity is None else rows.assembled(viscosity)
        if ground is not None:
            self._tie(rows, ground)
        diagonal = self._K.getDiagonal()
        self._scale = float(diagonal.norm()) / np.sqrt(rows.comm.size)
        diagonal.destroy()
        self._dynamic: dict[tuple[float, float, float], PETSc.KSP] = {}
        self._right, self._found, self._work = (rows.vector() for _ in range(3))

    @property
    def scale(self) -> float:
        """Size of the diagonal of K, which rows get that are held [N/m]."""
        return self._scale

    @property
    def matrices(self) -> tuple[PETSc.Mat, PETSc.Mat, PETSc.Mat | None]:
        """K, M and the viscous part of C; freed with the rest."""
        return self._K, self._M, self._viscosity

    def _tie(self, rows: Rows, ground: Ground) -> None:
        if self._viscosity is None:
            self._viscosity = self._K.copy()
            self._viscosity.zeroEntries()
        ground.add_to(rows, self._K, self._viscosity)

    def _hold(self, A: PETSc.Mat, rows: Ints, scale: float) -> None:
        A.zeroRowsColumns((self._first + rows).astype(PETSc.IntType), diag=scale)

    def increment(
        self,
        force: Array,
        u: Array,
        v: Array,
        dt: float,
        drag: float,
        xi: float,
        led: Array | None = None,
    ) -> Array:
        """Increment of a step, by the midpoint rule. Collective.

        Args:
            force: ρ at its middle, shape (nodes, 3) [N].
            u: δ at its start [m].
            v: δ̇ at its start [m/s].
            dt: Its length [s].
            drag: α of a force -α M δ̇ [1/s].
            xi: ξ of the numerical damping.
            led: Δδ at rows that supports hold, zero elsewhere, shape (nodes, 3) [m].

        Returns:
            Δδ, shape (nodes, 3) [m].
        """
        solver = self.factored(dt, drag, xi)
        right, work, found = self._right, self._work, self._found
        work.array[:] = v.reshape(-1) * (2 / dt)
        self._M.mult(work, right)
        right.array[:] += force.reshape(-1)
        work.array[:] = u.reshape(-1)
        self._K.mult(work, found)
        right.axpy(-1.0, found)
        if led is not None:
            work.array[:] = led.reshape(-1)
            factors = 0.5 + xi, 2 / dt**2 + drag / dt, 1 / dt
            for A, factor in zip((self._K, self._M, self._viscosity), factors, strict=True):
                if A is not None:
                    A.mult(work, found)
                    right.axpy(-factor, found)
        right.array[self._supported] = 0.0
        solver.solve(right, found)
        d: Array = found.array_r.reshape(-1, 3).copy()
        return d if led is None else d + led

    def by_impulses(self, momenta: Array) -> Array:
        """Velocities that impulses bring where supports hold none, Mff⁻¹ pf. Collective.

        Args:
            momenta: p of each, shape (impulses, nodes, 3) [N s].

        Returns:
            Of the same shape, zero at supports [m/s].
        """
        out = np.zeros_like(momenta)
        right, found = self._right, self._found
        solver = solver_of(self._free_mass(), brief=True)
        for k, p in enumerate(momenta):
            right.array[:] = p.reshape(-1)
            right.array[self._supported] = 0.0
            if right.norm() > 0:
                solver.solve(right, found)
                out[k] = found.array_r.reshape(-1, 3)
        solver.destroy()
        return out

    def _free_mass(self) -> PETSc.Mat:
        """Mff, and ones where supports hold; the caller destroys it. Collective."""
        M = self._M.copy()
        self._hold(M, self._supported, 1.0)
        return M

    def halted(self, v: Array) -> Array:
        """Velocities after an impact on supports that hold still, shape (nodes, 3). Collective."""
        self._work.array[:] = v.reshape(-1)
        held = self._work.array_r[self._supported]
        if not self._right.comm.tompi4py().allreduce(bool(held.any()), op=MPI.LOR):
            return v
        self._M.mult(self._work, self._right)
        self._right.array[self._supported] = 0.0
        M = self._free_mass()
        conjugate_gradients(M, self._right, self._found)  # factors take longer than one solve
        M.destroy()
        velocities: Array = self._found.array_r.reshape(v.shape).copy()
        return velocities

    def has_factors(self, dt: float, drag: float, xi: float) -> bool:
        """Whether the factors of a step are kept. Arguments as of `increment`."""
        return step_kind(dt, drag, xi) in self._dynamic

    def factored(self, dt: float, drag: float, xi: float) -> PETSc.KSP:
        """The factors of a step; those of few kinds of steps are kept. Arguments as of `increment`.

        Collective.
        """
        kind = step_kind(dt, drag, xi)
        if kind not in self._dynamic:
            dt = kind[0]  # alike, whichever step of a kind comes first
            if len(self._dynamic) == KINDS:
                self._dynamic.pop(next(iter(self._dynamic))).destroy()
            A = self._K.copy()
            A.scale(0.5 + xi)
            A.axpy(2 / dt**2 + drag / dt, self._M, self._pattern)
            if self._viscosity is not None:
                # Mostly that of K, which PETSc sees; a dashpot on a face couples further nodes.
                A.axpy(1 / dt, self._viscosity, PETSc.Mat.Structure.UNKNOWN_NONZERO_PATTERN)
            self._hold(A, self._supported, self._scale)
            self._dynamic[kind] = solver_of(A)
        return self._dynamic[kind]

    def destroy(self) -> None:
        """Free the PETSc objects. Collective."""
        own = self._K, self._M, self._viscosity, *self._dynamic.values()
        for item in (*own, self._mass, self._right, self._found, self._work):
            if item is not None:
                item.destroy()


def step_kind(dt: float, drag: float, xi: float) -> tuple[float, float, float]:
    """Key of a step's factors, and what it takes: times at the ends of steps are rounded."""
    return float(f"{dt:.9g}"), drag, xi

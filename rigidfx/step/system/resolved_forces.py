"""Forces of joints and supports without vibration that Δt does not resolve.

The effect `ResolvedForces` asks for them.

Vibrations far faster than Δt change their sign in each step and stay for ever, and λ with them, by
some 2 m v/Δt. With the tangent A = 2 M/Δt² + K/2 of the step, the rows G of joints and supports and
the velocity e = G v - ṡ across them,

    A w  + Gᵀ μ  = K v/2,      G w  = e,
    A w' + Gᵀ μ' = 2 M w/Δt²,  G w' = 0,

the velocities v - (w - w') fulfil the rows. A vibration of angular frequency ω keeps 1 - s² of its
amplitude, s = (ωΔt/2)²/(1 + (ωΔt/2)²): 0.99 at ten steps a period, 0.997 at thirteen, 8/(ωΔt)² far
beyond. A step between such velocities has the multipliers

    λ* = λ + (Δt/2) (μ'₁ - μ'₀).

`constraint_forces` is the case K = 0. As there no other step is needed. K (v₁ - v₀) is the change
of the cells' forces by v₁ at the end and -v₀ at the start, in which a rigid rotation strains
nothing. Dampers of ratio ζ add an error of 2 ζ² ωΔt of inertial forces. Stiffnesses of contacts and
of springs are in A only.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.equations import Equations
from rigidfx.step.linear.linear_solver import configure
from rigidfx.step.newton.border import BorderedFactors
from rigidfx.step.newton.factors import entries_of
from rigidfx.step.system.constraint_forces import Added, AddedForces, gained_across

# Strain by which forces are differentiated: rounding, and products of velocities, leave as much of
# K v as this is of the strain of one cell that moves alone.
STRAIN = float(np.cbrt(np.finfo(np.float64).eps))


class PresentTangent:
    """Responses to forces at the end of a step; `destroy` frees the solver.

    Numbers that are reported must not depend on when a solver renews its own tangent: that is
    another matter on other numbers of ranks, and in resumed runs.
    """

    def __init__(self, equations: Equations) -> None:
        """Create the solver. Collective."""
        self._equations, p = equations, equations.prolongation
        self._factors = BorderedFactors(equations)
        configure(self._factors.inner, True, p.size, len(p.layout.bodies) > 0)
        self._A: PETSc.Mat | None = None

    def renew(self) -> None:
        """Renew the tangent at the last iterate; other solvers keep theirs. Collective."""
        matrix = self._equations.tangent_matrix
        others = matrix.copy() if matrix.assembled else None
        entries = entries_of(matrix)
        self._equations.tangent()
        grown = entries_of(matrix) != entries
        if self._A is None or grown:
            self._free()
            self._A = matrix.copy()
        else:
            matrix.copy(self._A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._factors.renew(self._A)
        if others is not None:
            if not grown:
                others.copy(matrix, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            others.destroy()

    def solve(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Response to forces. Collective."""
        self._factors.apply(None, r, z)

    def _free(self) -> None:
        if self._A is not None:
            self._A.destroy()

    def destroy(self) -> None:
        """Free the solver. Collective."""
        self._factors.destroy()
        self._free()


class ResolvedConstraints(AddedForces):
    """λ* - λ by the tangent of a step."""

    def __init__(self, equations: Equations, scene: Scene) -> None:
        """Make a solver. Collective."""
        super().__init__(equations)
        self._tangent, p = PresentTangent(equations), equations.prolongation
        self._mass, self._cell, self._comm = equations.mass, scene.mean_cell_size, p.comm
        self._strains = self._any(sum(own.size for own in p.layout.flexible.values()))
        self._holds = self._any(p.prescribed.size)
        self._r, self._z = equations.unknowns(), equations.unknowns()

    def _any(self, count: int) -> bool:
        return bool(self._comm.allreduce(count) > 0)

    def find(self, state: State) -> tuple[Array, Added | None]:
        """See `AddedForces`."""
        equations, dt = self._equations, self._equations.dt
        p, d, v0 = equations.prolongation, equations.d.array_r, equations.trial.v0.array_r.copy()
        at, v1 = p.prescribed, 2 / dt * d - v0
        across = np.zeros(d.size)
        across[at] = v1[at] - v0[at]
        if self._prescribed.moves:
            across[at] -= self._gained(state)
        v1 -= across
        if p.attached.size:
            v0[p.attached] = p.rates(p.increments.start)
            v1[p.attached] = p.rates(p.increments.end)
        off = self._off(v0, v1)
        self._tangent.renew()
        f = self._change(state, -v0, v1) - 2 / dt**2 * self._momenta(across)
        of_bodies, w, _ = self._respond(f, p.no_bodies, off, across[at])
        blocks = p.increments.start.led_mass_blocks
        own = 2 / dt**2 * (blocks @ of_bodies[:, :, None])[:, :, 0]
        momenta = self._momenta(w)
        nothing = np.zeros(at.size)
        _, lasting, μ = self._respond(2 / dt**2 * momenta, own, 0.0 * off, nothing)
        held: Array = np.asarray((self._momenta(lasting) - momenta)[at] / dt, np.float64)
        if self._holds:
            held += dt / 4 * self._change(state, lasting, lasting)[at]
        if self._linkage is None:
            return held, None
        more = 0.5 * dt * μ
        on_vectors = self._linkage.on_vectors(more)
        if self._holds:
            held += self._on_nodes(on_vectors)[at]
        return held, lambda: (more, on_vectors)

    def _off(self, v0: Array, v1: Array) -> Array:
        """Change of velocities across rows of joints in the step, without compliance [m/s]."""
        linkage, increments = self._linkage, self._equations.prolongation.increments
        if linkage is None:
            return np.zeros(0)
        start, end = (
            linkage.averages.velocities(v0, increments.start),
            linkage.averages.velocities(v1, increments.end),
        )
        off = gained_across(linkage, start, end, linkage.drives.given)
        return np.where(linkage.compliance() == 0.0, off, 0.0)

    def _change(self, state: State, at_start: Array, at_end: Array) -> Array:
        """Derivative of the cells' forces along displacements of both ends of the step [N/m]."""
        size = max(np.abs(at_start).max(initial=0.0), np.abs(at_end).max(initial=0.0))
        size = self._comm.allreduce(float(size), op=MPI.MAX) if self._strains else 0.0
        none = np.zeros(at_start.size)
        if size == 0.0:
            return none
        share = STRAIN * self._cell / size
        before, dofs = state.snapshot(), self._equations.prolongation.layout.rows.dofs
        state.shift(dofs, share * at_start)
        forces = self._equations.cells_at(share * at_start, share * at_end)
        state.restore(before)
        return np.asarray((forces - self._equations.cells_at(none, none)) / share)

    def _momenta(self, v: Array) -> Array:
        """M v of the rows."""
        self._w.array[:] = v
        self._mass.mult(self._w, self._f)
        return self._f.array_r.copy()

    def _respond(
        self, f: Array, bodies: Array, off: Array, held: Array
    ) -> tuple[Array, Array, Array]:
        """Response of bodies, rows and multipliers of joints to forces; `held` is given."""
        self._f.array[:] = f
        self._equations.right_side(self._f, bodies, off, self._r)
        self._tangent.solve(self._r, self._z)
        of_bodies, multipliers = self._equations.response(self._z, held, self._w)
        return of_bodies, self._w.array_r.copy(), multipliers

    def destroy(self) -> None:
        """Free the solver and the vectors. Collective."""
        for item in (self._tangent, self._r, self._z):
            item.destroy()
        super().destroy()

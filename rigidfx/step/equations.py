"""Solve the equations of one step (or of statics) with PETSc's SNES.

The unknowns y are increments, of the free dofs and of the rigid bodies, so that a motion far from
the origin loses no digits; with d = d(y) = u₁ - u₀ and v₁ = 2 d/Δt - v₀ the residual reads

    f(d) = M (2 d/Δt - 2 v₀)/Δt + f_int(u₀, u₀ + d) - f_ext(t½),    R(y) = Lᵀ f + bodies' own,

all in newtons; the prolongation d(y) carries supports and bodies, see `prolongation` and
`increments`. d and f have rows for the active nodes only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.coupling.condensed_tangent import CondensedMatrix
from rigidfx.coupling.mass import Mass
from rigidfx.coupling.prolongation import Prolongation
from rigidfx.flexible.internal_forces import BoundForces, InternalForces
from rigidfx.mechanics.bodies import Bodies
from rigidfx.mechanics.body_step import Step
from rigidfx.scene.scene import Scene
from rigidfx.step.actions import Actions
from rigidfx.step.callbacks import errors_of_callbacks
from rigidfx.step.first_guess import Guess
from rigidfx.step.linear_solver import PREFIX, configure, default_options, prefers_direct
from rigidfx.step.petsc_options import loose_solves_allowed, monitor_solves
from rigidfx.step.round_off import Rounding
from rigidfx.step.stopping_test import (
    MAX_ITERATIONS,
    RELATIVE_TOLERANCE,
    StoppingTest,
    judged,
    reason_name,
)

__all__ = ["Equilibrium", "Solution"]

Array = npt.NDArray[np.float64]

MAX_FALLBACKS = 3  # direct solves in place of failed Krylov solves before Krylov is given up


@dataclass(frozen=True)
class Solution:
    """How the equations of a step were solved.

    Attributes:
        converged: Whether Newton met its tolerance.
        reason: SNES's reason in words.
        residuals: ‖R‖ [N] at each iterate.
        linear_iterations: Krylov iterations in total; factorisations count one.
        solver: Linear solver used, with a remark where it is a fall-back.
        place: Reference position of the largest residual [m], shape (3,), if not converged.
    """

    converged: bool
    reason: str
    residuals: tuple[float, ...]
    linear_iterations: int
    solver: str
    place: Array | None

    @property
    def iterations(self) -> int:
        """Newton iterations."""
        return len(self.residuals) - 1


def residual(snes: PETSc.SNES, y: PETSc.Vec, r: PETSc.Vec, equilibrium: Equilibrium) -> None:
    """SNES callback: R(y)."""
    equilibrium.residual(y, r)


def tangent(
    snes: PETSc.SNES, y: PETSc.Vec, A: PETSc.Mat, B: PETSc.Mat, equilibrium: Equilibrium
) -> None:
    """SNES callback: dR/dy at the iterate of the last residual."""
    equilibrium.tangent()


def convergence(
    snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float], equilibrium: Equilibrium
) -> int:
    """SNES callback: the stopping test, and how far the next linear system is to be solved."""
    reason = equilibrium.stop(iteration, norms[2])
    if reason == 0:
        equilibrium.limit_linear_error()
    return reason


class Equilibrium:
    """All PETSc objects of the steps of one division; `destroy` frees them.

    Attributes:
        prolongation: Map between unknowns and dofs.
        d: Increments of the active nodes found by the last solve [m].
        forces_out_of_balance: Residual of the last solve at the active nodes [N]; at held dofs it
            is what the supports exert.
        stop: Newton's stopping test, with the history of the last solve.
    """

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        bound: BoundForces,
        mass: Mass | None,
        prolongation: Prolongation,
        actions: Actions,
    ) -> None:
        """Create matrices, vectors and the SNES. Collective.

        Args:
            scene: The problem.
            forces: Owner of the coefficient u₁ that the forms read, and of u₀.
            bound: Forms over the flexible cells.
            mass: Mass operator, or None for statics.
            prolongation: Map between unknowns and dofs.
            actions: What acts on nodes and bodies.
        """
        self.prolongation = prolongation
        self._forces, self._bound, self._mass = forces, bound, mass
        self._actions = actions
        self._rows = prolongation.layout.rows
        self._reached = prolongation.layout.reached
        self._b = fem.Function(scene.space)
        self._tangent = CondensedMatrix(prolongation, bound.interior, bound.interface)
        self.d, self.forces_out_of_balance, self._work, self._inertia = (
            self._rows.vector() for _ in range(4)
        )
        self._moments: Array = np.empty((0, 4, 3))
        self._y = prolongation.unknowns()
        self._last: Array = np.empty(0)  # unknowns that d and u₁ belong to
        self._r = self._y.duplicate()
        self._dt = 0.0
        self._v0: PETSc.Vec = None
        self._step = prolongation.increments.step
        self._imposed: Array = np.empty(0)
        self._krylov = mass is not None and not prefers_direct(prolongation.size)
        self._fallbacks = 0
        self._rounding = Rounding(
            scene, forces, bound.undeformed, self._tangent, mass, prolongation, actions
        )
        self._snes = self._create_snes(scene)
        # How loosely Krylov solves may end, first and later.
        self._loosest = [(name, self._snes.getParamsEW()[name]) for name in ("rtol_0", "rtol_max")]
        rtol, _, _, max_it = self._snes.getTolerances()
        self.stop = StoppingTest(rtol, max_it)

    def _create_snes(self, scene: Scene) -> PETSc.SNES:
        snes = PETSc.SNES().create(scene.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setType(PETSc.SNES.Type.NEWTONLS)
        snes.setFunction(residual, self._r, args=(self,))
        snes.setJacobian(tangent, self._tangent.matrix, args=(self,))
        snes.setConvergenceTest(convergence, args=(self,))
        snes.setTolerances(rtol=RELATIVE_TOLERANCE, max_it=MAX_ITERATIONS)
        if self._krylov and loose_solves_allowed():
            # Linear systems are solved no further than Newton's quadratic convergence will get:
            # three Krylov iterations in ten are saved, for a Newton iteration in ten more at most.
            snes.setParamsEW(version=2, rtol_0=3e-3, gamma=0.3, alpha=2.0)
            snes.setUseEW(True)
        with default_options(PREFIX, snes_linesearch_type="basic"):
            snes.setFromOptions()
        monitor_solves(snes)
        self._configure(snes.getKSP(), not self._krylov)
        return snes

    def _configure(self, ksp: PETSc.KSP, direct: bool) -> None:
        p = self.prolongation
        configure(ksp, direct, p.size, len(p.layout.bodies) > 0)

    def solve(
        self,
        dt: float,
        v0: PETSc.Vec | None,
        imposed: Array,
        guesses: Sequence[Guess],
        start: Bodies,
    ) -> Solution:
        """Find the increment of one step, under the loads that the actions have now. Collective.

        Args:
            dt: Δt [s]; of no meaning in statics.
            v0: Velocity of the active nodes at the start of the step [m/s]; None in statics.
            imposed: Increments of the held dofs [m].
            guesses: First guesses; the one with the smallest residual is taken.
            start: The bodies at the start of the step.
        """
        self._step = Step(start, dt)
        self._dt, self._v0, self._imposed = dt, v0, imposed
        krylov = self._krylov and self._fallbacks < MAX_FALLBACKS
        reason, remark = self._iterate(guesses), ""
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE and krylov:
            # The Krylov solver gave up: repeat the step with a factorisation.
            self._fallbacks += 1
            self._configure(self._snes.getKSP(), True)
            reason, remark = self._iterate(guesses), " (fall-back from Krylov)"
            if self._fallbacks < MAX_FALLBACKS:
                self._configure(self._snes.getKSP(), False)
        elif reason < 0 and krylov and self._snes.getUseEW():
            # Newton may have failed on loosely solved systems, whose errors depend on the number
            # of ranks: before the step is cut, they are solved as if each were the last.
            self._snes.setUseEW(False)
            reason, remark = self._iterate(guesses), " (solved tightly)"
            self._snes.setUseEW(True)
        self.return_to(self._y)
        converged = reason > 0
        ksp = self._snes.getKSP()
        return Solution(
            converged,
            reason_name(reason),
            tuple(self.stop.history),
            self._snes.getLinearSolveIterations(),
            f"{ksp.getType()}+{ksp.getPC().getType()}{remark}",
            None if converged else self._worst_place(),
        )

    def _iterate(self, guesses: Sequence[Guess]) -> int:
        self.stop.restart()
        norms = [self._norm_at(guess) for guess in guesses] if len(guesses) > 1 else [0.0]
        self._start_at(guesses[int(np.argmin(np.nan_to_num(norms, nan=np.inf)))])
        self.stop.expect_rounding(
            self._rounding.in_residual(self._dt, self._v0, self._actions.external, self._step.start)
        )
        with errors_of_callbacks():
            self._snes.solve(None, self._y)
        return judged(int(self._snes.getConvergedReason()))

    def limit_linear_error(self) -> None:
        """Have the next Krylov solve leave no more than Newton's stopping test can stand."""
        if self._krylov:
            limits = {name: self.stop.linear_tolerance(value) for name, value in self._loosest}
            self._snes.setParamsEW(**limits)

    def _start_at(self, guess: Guess) -> None:
        self.prolongation.collapse(guess.increment, guess.bodies, self._y)

    def _norm_at(self, guess: Guess) -> float:
        self._start_at(guess)
        self.residual(self._y, self._r)
        return float(self._r.norm())

    def _expand(self, y: PETSc.Vec) -> None:
        """Set d and the forms' u₁ from the unknowns."""
        self._last = y.array_r.copy()
        self.prolongation.expand(y, self._step, self._imposed, self.d)
        u1, dofs = self._forces.u1.x, self._rows.dofs
        u1.array[dofs] = self._forces.u0.x.array[dofs] + self.d.array_r
        u1.scatter_forward()

    def return_to(self, y: PETSc.Vec) -> None:
        """Have d, u₁ and forces belong to these unknowns, as a rule the last ones. Collective.

        A solver of the user's, chosen by PETSc's options, may have looked elsewhere last.
        """
        same = np.array_equal(self._last, y.array_r)
        if not self.prolongation.comm.allreduce(same, op=MPI.LAND):
            self.residual(y, self._r)

    def residual(self, y: PETSc.Vec, r: PETSc.Vec) -> None:
        """R at the unknowns y. Collective.

        Args:
            y: Unknowns.
            r: Residual, overwritten [N].
        """
        self._expand(y)
        b = self._b.x
        b.array[self._reached] = 0.0
        fem.assemble_vector(b.array, self._bound.residual)
        b.scatter_reverse(la.InsertMode.add)
        f = self.forces_out_of_balance
        f.array[:] = b.array[self._rows.dofs]
        f.axpy(-1.0, self._actions.external)
        if self._mass is not None:
            # M (v₁ - v₀)/Δt with v₁ = 2 d/Δt - v₀, rounded as the update of the velocity is.
            self._v0.copy(self._work)
            self._work.axpby(2 / self._dt, -2.0, self.d)
            self._mass.mult(self._work, self._inertia)
            f.axpy(1 / self._dt, self._inertia)
        self._actions.resist_nodes(self.d, self._dt, f)
        self.prolongation.collapse(f.array_r, self._body_forces(), r)

    def _body_forces(self) -> Array:
        """Residual of the bodies, shape (bodies, 6) [N]. Collective."""
        increments = self.prolongation.increments
        if not len(increments):  # without bodies nothing of them is computed
            return np.empty((0, 6))
        self._moments = self.prolongation.moments(self.forces_out_of_balance)
        self._actions.resist_bodies(increments, self._moments)
        out = increments.inertia_force()
        out += increments.resultant(self._moments)
        out[:, 3:] -= self._actions.torques / self._step.start.of.length[:, None]
        return out

    def tangent(self) -> None:
        """Assemble and condense the tangent at the last iterate. Collective."""
        K = self._tangent
        K.assemble()
        if self._mass is not None:
            self._mass.add_to(K, 2 / self._dt**2, self.prolongation)
        self._actions.stiffen_nodes(K, self._dt, self.prolongation)
        K.finish(self._blocks() if self.prolongation.layout.bodies else None)

    def _blocks(self) -> Array:
        """Derivative of the bodies' rows that the condensed tangent does not hold."""
        increments = self.prolongation.increments
        blocks = increments.tangent(increments.couples(self._moments))
        self._actions.stiffen_bodies(increments, blocks)
        return blocks

    @property
    def unknowns(self) -> PETSc.Vec:
        """Unknowns y of the last solve [m]; not to be changed."""
        return self._y

    @property
    def tangent_matrix(self) -> PETSc.Mat:
        """The reduced tangent as `tangent` has left it [N/m]."""
        return self._tangent.matrix

    @property
    def strain_error(self) -> float:
        """Strain that the last solve and rounding may leave in a cell. Collective."""
        return self._rounding.in_strain(self.stop.history[-1])

    def _worst_place(self) -> Array:
        """Reference position of the node with the largest residual. Collective."""
        self.residual(self._y, self._r)
        f, free = np.zeros(self._rows.dofs.size), self.prolongation.free
        f[free] = self.forces_out_of_balance.array_r[free]
        size = np.nan_to_num(np.abs(f), nan=np.inf).reshape(-1, 3).max(axis=1)
        k = int(np.argmax(size)) if size.size else -1
        best: tuple[float, Any] = (float(size[k]), self._rows.X[k]) if k >= 0 else (-1.0, None)
        return max(self.prolongation.comm.allgather(best), key=lambda item: item[0])[1]

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        self._snes.destroy()
        own = self.d, self.forces_out_of_balance, self._work, self._inertia
        for item in (self._tangent, self._rounding, self._y, self._r, *own):
            item.destroy()

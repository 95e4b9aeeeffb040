"""Static equilibrium of one division: its parts, and the solve of one load step.

    R(u₁) = f_int(u₁) + f_contact(u₁) - f_ext(t₁) = 0

The equations are those of a step without inertia, with forces at its end; SNES solves them. Newton
steps are taken whole first. Where that fails, they are shortened by a line search with backtracking
(J. E. Dennis and R. B. Schnabel, Numerical Methods for Unconstrained Optimization and Nonlinear
Equations, 1996, Section 6.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nextafter

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from rigidfx.base.types import Array
from rigidfx.effects import Effect, Windowed
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.scene.scene import Scene
from rigidfx.state import State
from rigidfx.step.equations.energies import Measures
from rigidfx.step.linear.linear_solver import PREFIX, default_options
from rigidfx.step.newton.first_guess import Guess
from rigidfx.step.newton.newton import Newton, Solution
from rigidfx.step.system.division import Division
from rigidfx.step.system.system import System, Work


class StaticSystem(System):
    """The equations of statics of one division; `destroy` frees them.

    Attributes:
        unknowns: Number of unknowns.
        share: Part of the loads that acts in the present load step.
    """

    kind = "static"

    def __init__(
        self,
        scene: Scene,
        forces: InternalForces,
        state: State,
        effects: Sequence[Effect],
        acting: Sequence[Windowed],
        division: Division,
        fixed: float | None = None,
        loose: bool = False,
    ) -> None:
        """Bind everything to a division and to the effects that act. Collective.

        Args:
            scene: The problem.
            forces: Internal forces.
            state: The state; its bodies become those of the division.
            effects: All effects that take part.
            acting: Those with a time window that act.
            division: Division of the cells.
            fixed: Time at which functions of time are taken [s]: then loads grow in proportion to
                the path, supports and obstacles rest. The time of the path if None.
            loose: Whether a `StepDrag` is among the effects.
        """
        # A drag has no force where nothing moves.
        taking_part = [e for e in effects if not e.mass_damping]
        super().__init__(scene, forces, state, taking_part, acting, division, loose=loose)
        self._fixed, self.share = fixed, 1.0
        self.unknowns = self.prolongation.size
        self._searching: Newton | None = None
        self._last: tuple[Array, Array, float] | None = None  # increments and length of a step
        self._before = np.zeros(self.prolongation.prescribed.size)  # forces of supports there [N]
        self._rows = np.zeros_like(state.bodies.rates)  # those on the rows of bodies there [N]

    def solve_load(self, t0: float, t1: float, first: Guess | None = None) -> Solution:
        """Find the equilibrium at t₁ from that at t₀; the state is not changed. Collective.

        Args:
            t0: Start of the load step [s].
            t1: Its end [s]; loads whose window ends then act still.
            first: Where the iteration begins; by the last load step if None.

        Raises:
            SceneError: On every rank, if a user's function fails on any, or gives no numbers.
        """
        dt = t1 - t0
        self._set_loads(t1, dt)
        motors = (t0, dt) if self._fixed is None else (self._fixed, 0.0)
        self.begin(t0, t1, dt, motors, moves=self._fixed is None)
        rest, _ = self.at_rest
        guesses: tuple[Guess, ...] = (rest if first is None else first,)
        if self._last is not None and first is None:
            d, bodies, before = self._last
            guesses = (rest, Guess(dt / before * d, dt / before * bodies))
        solution = self.newton.solve(guesses)
        if not solution.converged:
            solution = self._search().solve(guesses[:1]).after(solution)
            if not solution.converged:
                self._renew()
        return solution

    def _set_loads(self, t: float, dt: float) -> None:
        """Evaluate actions at the end t of a load step of length dt [s]. Collective."""
        at = nextafter(t, -1.0) if self._fixed is None else self._fixed
        self._forces.set_time(at, dt)
        self.actions.set_time(at, dt)
        if self._fixed is None:
            return
        self.share = t
        self.actions.loads.scale(t)

    def take_drag(self, drag: float) -> None:
        """Tell joints the drag per mass of a load step [1/s²]."""
        if self.equilibrium.constraints is not None:
            self.equilibrium.constraints.drag = drag

    def load(self, t: float = 1.0, dt: float = 1.0) -> float:
        """Size of all dead loads at the end t of a load step of length dt [N]. Collective."""
        self._set_loads(t, dt)
        loads = self.actions.loads
        of_bodies = np.abs(loads.moments).sum() + np.abs(loads.torques).sum()
        return float(loads.vector.norm(PETSc.NormType.NORM_1) + of_bodies)

    def _search(self) -> Newton:
        """Newton's method with a line search, made when it is first needed. Collective."""
        if self._searching is None:
            with default_options(PREFIX, snes_linesearch_type="bt"):
                self._searching = Newton(self.equilibrium)
        return self._searching

    def _renew(self) -> None:
        """Make solvers anew: MUMPS may refuse to go on after a singular matrix. Collective."""
        for newton in (self.newton, self._searching):
            if newton is not None:
                newton.destroy()
        self.newton, self._searching = Newton(self.equilibrium), None

    @property
    def size(self) -> float:
        """Largest increment of a node in the last solution [m]. Collective."""
        own = np.linalg.norm(self.equilibrium.d.array_r.reshape(-1, 3), axis=1).max(initial=0.0)
        bodies = self.prolongation.increments.unknowns
        own = max(float(own), float(np.abs(bodies).max(initial=0.0)))
        return float(self._scene.comm.allreduce(own, op=MPI.MAX))

    @property
    def at_rest(self) -> tuple[Guess, Array]:
        """No increments, and poses of bodies at the start, shape (bodies, 4, 3)."""
        bodies = self._state.bodies
        none = np.zeros(self.layout.rows.dofs.size), self.prolongation.no_bodies
        return Guess(*none), bodies.pose

    @property
    def found(self) -> tuple[Guess, Array]:
        """Increments of the last solution, and poses of bodies there, shape (bodies, 4, 3)."""
        increments = self.prolongation.increments
        return Guess(self.equilibrium.d.array_r.copy(), increments.unknowns), increments.end.pose

    def distance(self, a: Guess, b: Guess) -> float:
        """Largest difference of two increments [m]. Collective."""
        nodes = np.abs(a.increment - b.increment).max(initial=0.0)
        own = max(float(nodes), float(np.abs(a.bodies - b.bodies).max(initial=0.0)))
        return float(self._scene.comm.allreduce(own, op=MPI.MAX))

    def accept_load(self, t0: float, t1: float, before: Measures) -> Work:
        """Put the last solution into the state, which then is at t₁. Collective.

        Where the time is fixed, that of the state stays. Work is by the trapezoidal rule; loads
        have done what energy has gained beside it, since `before` at the start t₀ of the load step.
        """
        equations, p = self.equilibrium, self.prolongation
        d, own, increments = equations.d.array_r, equations.body_rows, self.increments
        f = equations.forces_out_of_balance.array_r[p.prescribed]
        of_supports = self.of_supports(self.prescribed, f, 1.0)
        (work,), dissipated = self.taken(0.5 * (self._before + f) @ d[p.prescribed])
        if len(self.held):
            work += increments.work_of_supports(0.5 * (self._rows + own))
            self.add_frames(self.held, of_supports)
        touches, links = self.actions.touches(), self.told()
        moving = work + sum(touch.work for touch in touches.values())
        self._last = d.copy(), increments.unknowns, t1 - t0
        self._before, self._rows = f, own
        self.move(t1 if self._fixed is None else self._state.t, np.zeros(d.size))
        self.actions.accept()
        self.equilibrium.accept()
        gained = self.energies.measure(self._state).energy - before.energy
        loads = gained + sum(dissipated.values()) - moving
        dissipated = {kind: energy for kind, energy in dissipated.items() if energy != 0.0}
        named = *of_supports, np.zeros((2, 3)), touches, *links
        return Work(loads, moving, dissipated, *named)

    def destroy(self) -> None:
        """Free all PETSc objects. Collective."""
        if self._searching is not None:
            self._searching.destroy()
        super().destroy()

"""One time step: state in, result out. A step that does not converge is cut and tried again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from rigidfx import effects as fx
from rigidfx.equilibrium import Equilibrium, Solution
from rigidfx.errors import SceneError, StepError
from rigidfx.internal import InternalForces
from rigidfx.loads import NodalLoads
from rigidfx.mass import mass_operator
from rigidfx.monitor import Measures, Monitor
from rigidfx.prolongation import Prolongation
from rigidfx.scene import Scene
from rigidfx.state import State, initial_velocity
from rigidfx.supports import HeldDofs, Impact, acting, impose_velocity, rigidly_held

__all__ = ["Integrator", "StepResult"]

MAX_CUTS = 8  # a step is cut to at least 1/256 before it is given up


@dataclass(frozen=True)
class StepResult:
    """What one accepted step did.

    Attributes:
        dt: Its length [s].
        solution: How its equations were solved.
        cuts: How often it was cut before it converged.
        work_of_loads: f_ext·Δu [J].
        work_of_supports: Work of the reactions [J].
        reactions: Force each support exerts on the structure at the midpoint, shape (3,) [N].
        impact: Velocity taken over from a support that began at the start of the step.
    """

    dt: float
    solution: Solution
    cuts: int
    work_of_loads: float
    work_of_supports: float
    reactions: Mapping[str, npt.NDArray[np.float64]]
    impact: Impact | None


class Integrator:
    """Advances a state in time; a context manager that frees its PETSc objects.

    Attributes:
        scene: The problem.
        state: The state, changed by `step` only.
    """

    def __init__(self, scene: Scene, dt: float) -> None:
        """Compile the forms, assemble mass and loads, set the initial state. Collective.

        Args:
            scene: The problem.
            dt: Nominal Δt [s].

        Raises:
            SceneError: If the initial velocity contradicts a support, or a preload is not held.
            StepError: If the static preload does not converge.
        """
        self.scene, self.state = scene, State(scene)
        velocity = initial_velocity(scene)
        self._resolution = 1e-9 * dt
        self._forces = InternalForces(scene, self.state.u)
        self._cells = self._forces.cells()
        self._bound = self._forces.bind(self._cells)
        self._mass = mass_operator(scene, self._cells)
        self._loads = NodalLoads(scene, scene.named(fx.DeadLoad))
        self._monitor = Monitor(scene, self._forces, self._mass, self._cells)
        self._f_ext, self._guess = (self.state.u.x.petsc_vec.duplicate() for _ in range(2))
        self._held = HeldDofs(scene, acting(scene, 0.0, self._resolution))
        self._preload()
        self.state.v.x.array[:] = velocity.reshape(-1)
        self._equilibrium = self._partition()
        self._impact = self._begin(self._held.active, dt)
        self._trial = np.inf  # length of the next attempt after a cut

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the current partition."""
        return self._equilibrium.prolongation.size

    def measure(self) -> Measures:
        """Energies and momenta of the current state. Collective."""
        self._forces.u1.x.array[:] = self.state.u.x.array
        return self._monitor.measure(self.state)

    def step(self, target: float) -> StepResult:
        """Advance to the target time, or as far towards it as a cut step gets. Collective.

        Args:
            target: Time at which the step is to end [s].

        Raises:
            SceneError: If a load takes a value that is not finite.
            StepError: If the step does not converge after all cuts.
        """
        self._follow_supports(target - self.state.t)
        cuts, solution = 0, None
        while cuts <= MAX_CUTS:
            left = target - self.state.t
            dt = left if self._trial >= left * (1 - 1e-9) else self._trial
            solution = self._attempt(dt)
            if solution.converged:
                self._trial = np.inf if dt == left and cuts == 0 else 2 * dt
                return self._accept(dt, target if dt == left else self.state.t + dt, solution, cuts)
            cuts += 1
            self._trial = dt / 2
        assert solution is not None
        x, y, z = solution.place if solution.place is not None else (np.nan,) * 3
        raise StepError(
            f"The step from t = {self.state.t:.9g} s did not converge, not even with "
            f"Δt = {dt:.3g} s ({solution.reason}; residuals "
            f"{', '.join(f'{r:.2e}' for r in solution.residuals[:6])} N). The largest residual is "
            f"at the node X = ({x:.6g}, {y:.6g}, {z:.6g}) m. Try a smaller Δt, look at loads and "
            "supports near that place, or add NumericalDamping."
        )

    def _attempt(self, dt: float) -> Solution:
        state = self.state
        middle = state.t + dt / 2
        self._forces.set_time(middle)
        self._loads.evaluate(middle, self._f_ext)
        v0 = state.v.x.petsc_vec
        v0.copy(self._guess)
        self._guess.scale(dt)
        prescribed = self._held.increments(state.t, state.t + dt)
        return self._equilibrium.solve(dt, v0, self._f_ext, prescribed, self._guess)

    def _accept(self, dt: float, t: float, solution: Solution, cuts: int) -> StepResult:
        state, d = self.state, self._equilibrium.d
        forces = self._equilibrium.forces_out_of_balance.array_r
        held = self._held.mask
        work_of_supports = float(self.scene.sum(forces[held] @ d.array_r[held]))
        reactions = self._held.reactions(forces)
        n = 3 * self.scene.owned_nodes
        state.v.x.array[:n] = 2 / dt * d.array_r - state.v.x.array[:n]
        state.v.x.scatter_forward()
        state.u.x.array[:] = self._forces.u1.x.array
        state.t = t
        impact, self._impact = self._impact, None
        work = self._f_ext.dot(d)
        return StepResult(dt, solution, cuts, work, work_of_supports, reactions, impact)

    # Supports -----------------------------------------------------------------------------------

    def _partition(self) -> Equilibrium:
        prolongation = Prolongation(self._held.mask, self.scene.comm)
        return Equilibrium(self.scene, self._forces, self._bound, self._mass, prolongation)

    def _follow_supports(self, dt: float) -> None:
        """Change the partition where a support begins or ends; meet jumps of prescribed motion."""
        t, before = self.state.t, self._held.active
        now = acting(self.scene, t, self._resolution)
        if now != before:
            self._equilibrium.destroy()
            self._held = HeldDofs(self.scene, now)
            self._equilibrium = self._partition()
        jumping = tuple(
            s
            for s in now
            if s not in before or any(abs(t - b) <= self._resolution for b in s.breakpoints)
        )
        if jumping:
            self._impact = self._begin(jumping, dt) or self._impact

    def _begin(self, supports: tuple[fx.Support, ...], dt: float) -> Impact | None:
        if not supports:
            return None
        return impose_velocity(
            self.scene,
            self.state,
            self._mass,
            self._equilibrium.prolongation,
            self._held.velocities(self.state.t, dt),
            tuple(s.where for s in supports),
        )

    # Statics ------------------------------------------------------------------------------------

    def _preload(self) -> None:
        """Bring the state into the static equilibrium that the scene asks for."""
        for preload in self.scene.named(fx.Preload):
            if not rigidly_held(self.scene, self._held):
                raise SceneError(
                    "Preload: the supports that act at the start leave a rigid motion free, so "
                    "there is no static equilibrium. Add supports or drop the preload."
                )
            loads = NodalLoads(self.scene, preload.loads)
            prolongation = Prolongation(self._held.mask, self.scene.comm)
            statics = Equilibrium(
                self.scene,
                self._forces,
                self._forces.bind_static(self._cells),
                None,
                prolongation,
            )
            nothing = np.zeros(prolongation.held.size)
            loads.evaluate(0.0, self._f_ext)
            full = self._f_ext.copy()
            for k in range(1, preload.increments + 1):
                full.copy(self._f_ext)
                self._f_ext.scale(k / preload.increments)
                self._guess.set(0.0)
                solution = statics.solve(1.0, None, self._f_ext, nothing, self._guess)
                if not solution.converged:
                    raise StepError(
                        f"Preload: increment {k} of {preload.increments} did not converge "
                        f"({solution.reason}); the largest residual is at X = {solution.place} m. "
                        "Use more increments or smaller loads."
                    )
                self.state.u.x.array[:] = self._forces.u1.x.array
            statics.destroy()
            full.destroy()

    # Life ---------------------------------------------------------------------------------------

    def close(self) -> None:
        """Free all PETSc objects. Collective."""
        self._equilibrium.destroy()
        self._mass.destroy()
        self._f_ext.destroy()
        self._guess.destroy()

    def __enter__(self) -> Integrator:
        """Nothing to do: all is made at construction."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Free all PETSc objects."""
        self.close()

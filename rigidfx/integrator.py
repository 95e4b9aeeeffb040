"""One time step: state in, result out. A step that does not converge is cut and tried again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import TracebackType

import numpy as np
import numpy.typing as npt

from rigidfx import effects as fx
from rigidfx.equilibrium import Solution
from rigidfx.errors import StepError
from rigidfx.internal import InternalForces
from rigidfx.monitor import Measures
from rigidfx.parts import Parts, named_parts
from rigidfx.preload import apply_preload
from rigidfx.scene import Scene
from rigidfx.state import State, initial_velocity
from rigidfx.supports import HeldDofs, Impact, acting, impose_velocity
from rigidfx.system import System

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
        velocity = initial_velocity(scene, dt)
        self._resolution = 1e-9 * dt
        self._trial = np.inf  # length of the next attempt after a cut
        self._forces = InternalForces(scene, self.state.u)
        self._active = acting(scene, 0.0, self._resolution)
        apply_preload(scene, self._forces, self.state, HeldDofs(scene, self._active))
        self.state.v.x.array[:] = velocity.reshape(-1)
        self._system = self._bind(named_parts(scene, self._forces, self.state, self._active))
        self._impact = self._begin(self._active, dt, self.measure())

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the current partition."""
        return self._system.equilibrium.prolongation.size

    def measure(self) -> Measures:
        """Energies and momenta of the current state. Collective."""
        self._forces.u1.x.array[:] = self.state.u.x.array
        return self._system.monitor.measure(self.state)

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
            solution = self._system.solve(self.state, dt)
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
            f"{', '.join(f'{r:.2e}' for r in solution.residuals[:6]) or 'not finite'} N). "
            f"The largest residual is at the node X = ({x:.6g}, {y:.6g}, {z:.6g}) m. Try a "
            "smaller Δt, look at loads and supports near that place, or add NumericalDamping."
        )

    def _accept(self, dt: float, t: float, solution: Solution, cuts: int) -> StepResult:
        work = self._system.accept(self.state, dt, t)
        impact = self.take_impact()
        return StepResult(dt, solution, cuts, work.loads, work.supports, work.reactions, impact)

    def take_impact(self) -> Impact | None:
        """What the begin of a support did since this was last asked."""
        impact, self._impact = self._impact, None
        return impact

    # Partition ----------------------------------------------------------------------------------

    def _bind(self, parts: Parts) -> System:
        self.state.bodies, self.state.motions = parts.bodies, parts.motions
        held = HeldDofs(self.scene, self._active, parts.carried_nodes)
        self._held = held
        return System(
            self.scene, self._forces, self.state, parts.flexible, held, parts.carried_cells
        )

    def _follow_supports(self, dt: float) -> None:
        """Change the partition where a support begins or ends; meet jumps of prescribed motion."""
        t, before = self.state.t, self._active
        now = acting(self.scene, t, self._resolution)
        jumping = tuple(
            s
            for s in now
            if s not in before or any(abs(t - b) <= self._resolution for b in s.breakpoints)
        )
        # A body that a support takes over must count as the body here: interface nodes of the
        # flexible side have velocities of their own.
        measures = self.measure() if jumping else None
        if now != before:
            self.state.rebuild()
            self._system.destroy()
            self._active = now
            parts = named_parts(self.scene, self._forces, self.state, now)
            self._system = self._bind(parts)
        if measures is not None:
            self._impact = self._begin(jumping, dt, measures) or self._impact

    def _begin(
        self, supports: tuple[fx.Support, ...], dt: float, before: Measures
    ) -> Impact | None:
        """Meet the velocity of supports that begin; the difference goes to the ledger."""
        if not supports:
            return None
        velocities = self._held.velocities(self.state.t, dt)
        partition, mass = self._system.partition, self._system.mass
        if not impose_velocity(self.scene, self.state, mass, partition, velocities):
            return None
        after = self.measure()
        return Impact(
            self.state.t,
            tuple(s.where for s in supports),
            after.kinetic - before.kinetic,
            after.linear_momentum - before.linear_momentum,
            after.angular_momentum - before.angular_momentum,
        )

    # Life ---------------------------------------------------------------------------------------

    def close(self) -> None:
        """Free all PETSc objects. Collective."""
        self._system.destroy()

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

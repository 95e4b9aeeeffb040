"""The only time loop: a generator of step reports.

    scene → integrator.step → Report → … → Recorder

Steps end on the grid k Δt and on every breakpoint the scene declares; a step that had to be cut
shows up as several reports on the way to its end.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.body import BodyMotion, RigidBody
from rigidfx.effects import next_breakpoint
from rigidfx.errors import SceneError, number
from rigidfx.integrator import Integrator, StepResult
from rigidfx.monitor import Measures
from rigidfx.probes import Probes
from rigidfx.scene import Scene
from rigidfx.state import State
from rigidfx.supports import Impact

__all__ = ["BodyReport", "Report", "simulate"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BodyReport:
    """A rigid body at one time.

    Attributes:
        name: Name of its set of cells.
        mass: m [kg].
        centre: Position of the centre of mass, shape (3,) [m].
        orientation: Rotation R since it became rigid, shape (3, 3).
        velocity: Velocity of the centre of mass, shape (3,) [m/s].
        angular_velocity: ω in space, shape (3,) [rad/s].
        linear_momentum: m ṙ, shape (3,) [kg m/s].
        spin: Angular momentum about the centre of mass, shape (3,) [kg m²/s].
        angular_momentum: Angular momentum about the origin, shape (3,) [kg m²/s].
        kinetic: Kinetic energy [J].
    """

    name: str
    mass: float
    centre: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array
    linear_momentum: Array
    spin: Array
    angular_momentum: Array
    kinetic: float


@dataclass(frozen=True)
class Report:
    """One accepted step; numbers are summed over ranks and equal on all of them.

    Attributes:
        step: Number of the step; 0 is the initial state.
        t: Time at its end [s].
        dt: Its length [s]; 0 for the initial state.
        iterations: Newton iterations.
        residuals: ‖R‖ [N] at each Newton iterate.
        linear_iterations: Krylov iterations in total.
        solver: Linear solver used.
        cuts: How often the step was cut before it converged.
        unknowns: Number of unknowns of the step.
        kinetic: Kinetic energy [J].
        strain: Strain energy [J].
        linear_momentum: L, shape (3,) [kg m/s].
        angular_momentum: J about the origin, shape (3,) [kg m²/s].
        momentum_scale: Σ |(M v)ᵢ| [kg m/s], what L is to be compared with.
        work_of_loads: Work of the loads in this step [J].
        work_of_supports: Work of the reactions in this step [J].
        reactions: Force of each support on the structure at the step's midpoint, by the name of
            its set, shape (3,) [N].
        impact: What the begin of a support, or a jump of its velocity, did at the step's start; at
            t = 0 in the report of the initial state.
        bodies: The rigid bodies.
        probes: Displacement of each probe, shape (3,) [m].
        wall: Wall time of the step [s].
        state: Displacement and velocity; read, do not change. It lives on with the simulation.
            `state.rebuild()` brings nodes inside bodies up to date.
    """

    step: int
    t: float
    dt: float
    iterations: int
    residuals: tuple[float, ...]
    linear_iterations: int
    solver: str
    cuts: int
    unknowns: int
    kinetic: float
    strain: float
    linear_momentum: Array
    angular_momentum: Array
    momentum_scale: float
    work_of_loads: float
    work_of_supports: float
    reactions: Mapping[str, Array]
    impact: Impact | None
    bodies: tuple[BodyReport, ...]
    probes: Mapping[str, Array]
    wall: float
    state: State

    @property
    def energy(self) -> float:
        """H = kinetic + strain [J]."""
        return self.kinetic + self.strain


def simulate(
    scene: Scene, dt: float, t_end: float, *, progress: bool | None = None
) -> Iterator[Report]:
    """Integrate a scene from t = 0.

    Args:
        scene: The problem.
        dt: Nominal time step Δt [s].
        t_end: End of the simulation [s].
        progress: Whether rank 0 shows a progress bar on standard error; where that is a terminal
            if None.

    Returns:
        A generator of reports, the first of them of the initial state. Everything it holds is
        freed when it ends or is closed.

    Raises:
        SceneError: Before the first report, if dt or t_end cannot be used or the initial state is
            in conflict; later, if a load takes a value that is not finite.
        StepError: If a step does not converge, even after cutting.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"simulate: scene must be a Scene, got {scene!r}.")
    dt, t_end = number("simulate", "dt", dt), number("simulate", "t_end", t_end)
    if not dt > 0:
        raise SceneError(f"simulate: dt must be a finite number > 0, got {dt!r}.")
    if not t_end > 0:
        raise SceneError(f"simulate: t_end must be a finite number > 0, got {t_end!r}.")
    probes = Probes(scene)
    return _reports(scene, Integrator(scene, dt), probes, dt, t_end, progress)


def _reports(
    scene: Scene,
    integrator: Integrator,
    probes: Probes,
    dt: float,
    t_end: float,
    progress: bool | None,
) -> Iterator[Report]:
    breakpoints = scene.breakpoints
    resolution = 1e-9 * dt
    with integrator, _progress_bar(scene, t_end, progress) as bar:
        step, grid, state = 0, 1, integrator.state
        yield _report(0, integrator, probes, None, integrator.measure(), 0.0)
        while state.t < t_end - resolution:
            while grid * dt <= state.t + resolution:
                grid += 1
            target = min(t_end, grid * dt)
            stop = next_breakpoint(breakpoints, state.t, resolution)
            if stop < target - resolution or abs(stop - target) <= resolution:
                target = stop
            start = perf_counter()
            result = integrator.step(target)
            step += 1
            measures = integrator.measure()
            wall = perf_counter() - start
            bar.update(result.dt)
            yield _report(step, integrator, probes, result, measures, wall)


def _report(
    step: int,
    integrator: Integrator,
    probes: Probes,
    result: StepResult | None,
    measures: Measures,
    wall: float,
) -> Report:
    state, solution = integrator.state, result.solution if result else None
    return Report(
        step=step,
        t=state.t,
        dt=result.dt if result else 0.0,
        iterations=solution.iterations if solution else 0,
        residuals=solution.residuals if solution else (),
        linear_iterations=solution.linear_iterations if solution else 0,
        solver=solution.solver if solution else "",
        cuts=result.cuts if result else 0,
        unknowns=integrator.unknowns,
        kinetic=measures.kinetic,
        strain=measures.strain,
        linear_momentum=measures.linear_momentum,
        angular_momentum=measures.angular_momentum,
        momentum_scale=measures.momentum_scale,
        work_of_loads=result.work_of_loads if result else 0.0,
        work_of_supports=result.work_of_supports if result else 0.0,
        reactions=result.reactions if result else {},
        impact=result.impact if result else integrator.take_impact(),
        bodies=tuple(map(_body_report, state.bodies, state.motions)),
        probes=probes.displacements(state),
        wall=wall,
        state=state,
    )


def _body_report(body: RigidBody, motion: BodyMotion) -> BodyReport:
    momentum, spin = body.mass * motion.velocity, motion.angular_momentum(body)
    return BodyReport(
        name=body.name,
        mass=body.mass,
        centre=motion.r,
        orientation=motion.R,
        velocity=motion.velocity,
        angular_velocity=motion.angular_velocity,
        linear_momentum=momentum,
        spin=spin,
        angular_momentum=np.cross(motion.r, momentum) + spin,
        kinetic=motion.kinetic(body),
    )


def _progress_bar(scene: Scene, t_end: float, progress: bool | None) -> Any:
    from tqdm import tqdm

    terminal = sys.stderr.isatty()
    return tqdm(
        total=t_end,
        disable=scene.comm.rank != 0 or not (terminal if progress is None else progress),
        unit="s",
        file=sys.stderr if terminal else _Lines(),
        mininterval=0.1 if terminal else 5.0,
        bar_format="{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]",
    )


class _Lines:
    """Standard error where it is no terminal: the bar as a line each time.

    mpirun passes on whole lines only, so that a bar that rewrites its line would not be seen.
    """

    def write(self, text: str) -> None:
        """Write a state of the bar, without what moves a cursor."""
        if text.strip():
            sys.stderr.write(text.strip() + "\n")

    def flush(self) -> None:
        """Flush standard error."""
        sys.stderr.flush()

"""The only time loop: a generator of step reports.

    scene → integrator.step → Report → … → Recorder

Steps end on the grid k Δt and on every breakpoint the scene declares; a step that had to be cut
shows up as several reports on the way to its end.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

from rigidfx.body import BodyMotion, RigidBody
from rigidfx.criterion import StrainRate
from rigidfx.errors import SceneError
from rigidfx.integrator import Integrator, StepResult
from rigidfx.ledger import Event
from rigidfx.monitor import Measures
from rigidfx.probes import Probes
from rigidfx.rotation import skew
from rigidfx.scene import Scene
from rigidfx.state import State
from rigidfx.supports import Impact
from rigidfx.switching import Switching
from rigidfx.timeline import Timeline

__all__ = ["BodyReport", "Report", "simulate"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BodyReport:
    """A rigid body at one time.

    Attributes:
        name: Name of its set of cells, or "part" and its number.
        number: Its number ≥ 1, by which fields show it.
        cells: Number of its cells.
        mass: m [kg].
        centre: Position of the centre of mass, shape (3,) [m].
        orientation: Rotation R since it became rigid, shape (3, 3).
        velocity: Velocity of the centre of mass, shape (3,) [m/s].
        angular_velocity: ω in space, shape (3,) [rad/s].
        linear_momentum: m ṙ, shape (3,) [kg m/s].
        spin: Angular momentum about the centre of mass, shape (3,) [kg m²/s].
        angular_momentum: Angular momentum about the origin, shape (3,) [kg m²/s].
        kinetic: Kinetic energy [J].
        stored: Energy that it keeps for its release [J].
    """

    name: str
    number: int
    cells: int
    mass: float
    centre: Array
    orientation: Array
    velocity: Array
    angular_velocity: Array
    linear_momentum: Array
    spin: Array
    angular_momentum: Array
    kinetic: float
    stored: float


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
        strain: Strain energy of the flexible cells [J].
        stored: Energy that bodies keep for their release: their strain energy, and the kinetic
            energy of what they vibrated when they were frozen [J].
        linear_momentum: L, shape (3,) [kg m/s].
        angular_momentum: J about the origin, shape (3,) [kg m²/s].
        momentum_scale: Σ |(M v)ᵢ| [kg m/s], what L is to be compared with; a body counts with
            |m ṙ| + |π|/ℓ.
        work_of_loads: Work of the loads in this step [J].
        work_of_supports: Work of the reactions in this step [J].
        reactions: Force of each support on the structure at the step's midpoint, by the name of
            its set, shape (3,) [N].
        impact: What the begin of a support, or a jump of its velocity, did at the step's start; at
            t = 0 in the report of the initial state.
        bodies: The rigid bodies.
        events: What was frozen and released since the last report: right before the step, and at
            its end. Energies, momenta and bodies of the report are those after them.
        closeness: How close any cell's strain rate came to its tolerance at the end of a window,
            the least |e/tol - 1|; NaN if the step ended none.
        strain_rate: Strain rate of each owned cell in the step [1/s], zero in bodies; None where
            it is not measured. It changes with the next step.
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
    stored: float
    linear_momentum: Array
    angular_momentum: Array
    momentum_scale: float
    work_of_loads: float
    work_of_supports: float
    reactions: Mapping[str, Array]
    impact: Impact | None
    bodies: tuple[BodyReport, ...]
    events: tuple[Event, ...]
    closeness: float
    strain_rate: Array | None
    probes: Mapping[str, Array]
    wall: float
    state: State

    @property
    def energy(self) -> float:
        """H = kinetic + strain + stored [J]."""
        return self.kinetic + self.strain + self.stored


def simulate(
    scene: Scene,
    dt: float | Mapping[float, float],
    t_end: float,
    *,
    rigidify: StrainRate | None = None,
    progress: bool | None = None,
) -> Iterator[Report]:
    """Integrate a scene from t = 0.

    Args:
        scene: The problem.
        dt: Nominal time step Δt [s], or one from each of several times on: {0: 0.01, 2.2: 0.002}.
        t_end: End of the simulation [s].
        rigidify: When parts become rigid and flexible again; no part does if None.
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
    timeline = Timeline(dt, t_end)
    if rigidify is not None and not isinstance(rigidify, StrainRate):
        raise SceneError(f"simulate: rigidify must be a StrainRate, got {rigidify!r}.")
    if rigidify is not None and not scene.scheme.couples:
        raise SceneError(
            f"simulate: {type(scene.scheme).__name__} does not couple to rigid bodies; take "
            "EnergyMomentum or Midpoint."
        )
    probes = Probes(scene)
    integrator = Integrator(scene, timeline.dt, rigidify.measure if rigidify else None)
    switching = None
    if rigidify is not None:
        switching = Switching(scene, rigidify, integrator, timeline.resolution)
        timeline.stop_at(switching.breakpoints)
    timeline.stop_at(scene.breakpoints)
    return _reports(scene, integrator, switching, probes, timeline, progress)


def _reports(
    scene: Scene,
    integrator: Integrator,
    switching: Switching | None,
    probes: Probes,
    timeline: Timeline,
    progress: bool | None,
) -> Iterator[Report]:
    with integrator, _progress_bar(scene, timeline.t_end, progress) as bar:
        step, state = 0, integrator.state
        yield _report(0, integrator, probes, None, integrator.measure())
        while not timeline.over(state.t):
            target = timeline.next(state.t)
            start = perf_counter()
            events = switching.before(target - state.t) if switching else []
            result = integrator.step(target)
            step += 1
            report = _report(step, integrator, probes, result, integrator.measure())
            if switching is not None:
                now = switching.after(result, report)
                report = _amended(report, integrator, [*events, *now], switching.closeness)
            bar.update(result.dt)
            yield replace(report, wall=perf_counter() - start)


def _report(
    step: int,
    integrator: Integrator,
    probes: Probes,
    result: StepResult | None,
    measures: Measures,
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
        stored=measures.stored,
        linear_momentum=measures.linear_momentum,
        angular_momentum=measures.angular_momentum,
        momentum_scale=measures.momentum_scale,
        work_of_loads=result.work_of_loads if result else 0.0,
        work_of_supports=result.work_of_supports if result else 0.0,
        reactions=result.reactions if result else {},
        impact=result.impact if result else integrator.take_impact(),
        bodies=_body_reports(state),
        events=(),
        closeness=np.nan,
        strain_rate=integrator.strain_rate,
        probes=probes.displacements(state),
        wall=0.0,
        state=state,
    )


def _amended(
    report: Report, integrator: Integrator, events: Sequence[Event], closeness: float
) -> Report:
    """A report after what was switched around its step. Collective."""
    report = replace(report, events=tuple(events), closeness=closeness)
    if not any(event.t == report.t for event in events):
        return report
    now = integrator.measure()
    return replace(
        report,
        kinetic=now.kinetic,
        strain=now.strain,
        stored=now.stored,
        linear_momentum=now.linear_momentum,
        angular_momentum=now.angular_momentum,
        momentum_scale=now.momentum_scale,
        bodies=_body_reports(integrator.state),
    )


def _body_reports(state: State) -> tuple[BodyReport, ...]:
    return tuple(map(_body_report, state.bodies, state.motions))


def _body_report(body: RigidBody, motion: BodyMotion) -> BodyReport:
    momentum, spin = body.mass * motion.velocity, motion.angular_momentum(body)
    return BodyReport(
        name=body.name,
        number=body.number,
        cells=body.size,
        mass=body.mass,
        centre=motion.r,
        orientation=motion.R,
        velocity=motion.velocity,
        angular_velocity=motion.angular_velocity,
        linear_momentum=momentum,
        spin=spin,
        angular_momentum=skew(motion.r) @ momentum + spin,
        kinetic=motion.kinetic(body),
        stored=body.frozen.energy,
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

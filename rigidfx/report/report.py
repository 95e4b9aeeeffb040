"""What a run tells of each of its steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rigidfx.mechanics.rigid_body import BodyMotion, RigidBody
from rigidfx.mechanics.rotation import skew
from rigidfx.report.events import Event
from rigidfx.report.probes import Probes
from rigidfx.state import State
from rigidfx.step.energies import Measures
from rigidfx.step.stepper import Integrator, StepResult
from rigidfx.step.supports import Impact

__all__ = ["BodyReport", "Report", "amended", "report_of"]

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
        angular_momentum_about_centre: J ω, shape (3,) [kg m²/s].
        angular_momentum: Angular momentum about the origin, shape (3,) [kg m²/s].
        kinetic: Kinetic energy [J].
        stored: Energy that it keeps for its release [J].
        inertia_ratio: Largest ratio, about any axis, of its moment of inertia to the exact one of
            its cells: above 1 where masses are lumped.
        kinetic_excess: Kinetic energy that it has for this reason only [J].
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
    angular_momentum_about_centre: Array
    angular_momentum: Array
    kinetic: float
    stored: float
    inertia_ratio: float
    kinetic_excess: float


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
        springs: Potential energy of springs to ground [J].
        linear_momentum: L, shape (3,) [kg m/s].
        angular_momentum: J about the origin, shape (3,) [kg m²/s].
        momentum_scale: Σ |(M v)ᵢ| [kg m/s], what L is to be compared with; a body counts with
            |m ṙ| + |π|/ℓ.
        work_of_loads: Work of the loads in this step [J].
        work_of_supports: Work of the reactions in this step [J].
        dissipated: Energy that damping took in this step [J], by the name of its kind, such as
            "KelvinVoigt" (a spring's dashpot counts as "Spring").
        reactions: Force of each support on the structure at the step's midpoint, by the name of
            its set, shape (3,) [N].
        reaction_moments: Its moment about the origin, likewise [N m].
        impact: What the start of a support, or a jump of its velocity, did at the step's start; at
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
    springs: float
    linear_momentum: Array
    angular_momentum: Array
    momentum_scale: float
    work_of_loads: float
    work_of_supports: float
    dissipated: Mapping[str, float]
    reactions: Mapping[str, Array]
    reaction_moments: Mapping[str, Array]
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
        """H = kinetic + strain + stored + springs [J]."""
        return self.kinetic + self.strain + self.stored + self.springs


def report_of(
    step: int,
    integrator: Integrator,
    probes: Probes,
    result: StepResult | None,
    measures: Measures,
) -> Report:
    """The report of a step, or of the initial state. Collective.

    Args:
        step: Its number.
        integrator: What has made it.
        probes: Points that are reported.
        result: What the step did; None for the initial state.
        measures: Energies and momenta after it.
    """
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
        springs=measures.springs,
        linear_momentum=measures.linear_momentum,
        angular_momentum=measures.angular_momentum,
        momentum_scale=measures.momentum_scale,
        work_of_loads=result.work_of_loads if result else 0.0,
        work_of_supports=result.work_of_supports if result else 0.0,
        dissipated=result.dissipated if result else {},
        reactions=result.reactions if result else {},
        reaction_moments=result.reaction_moments if result else {},
        impact=result.impact if result else integrator.take_impact(),
        bodies=_body_reports(state),
        events=(),
        closeness=np.nan,
        strain_rate=integrator.strain_rate,
        probes=probes.displacements(state),
        wall=0.0,
        state=state,
    )


def amended(
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
        springs=now.springs,
        linear_momentum=now.linear_momentum,
        angular_momentum=now.angular_momentum,
        momentum_scale=now.momentum_scale,
        bodies=_body_reports(integrator.state),
    )


def _body_reports(state: State) -> tuple[BodyReport, ...]:
    return tuple(map(_body_report, state.bodies, state.motions))


def _body_report(body: RigidBody, motion: BodyMotion) -> BodyReport:
    momentum, own = body.mass * motion.velocity, motion.angular_momentum(body)
    W = motion.angular_velocity_body
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
        angular_momentum_about_centre=own,
        angular_momentum=skew(motion.r) @ momentum + own,
        kinetic=motion.kinetic(body),
        stored=body.frozen.energy,
        inertia_ratio=body.inertia_ratio,
        kinetic_excess=float(0.5 * W @ body.excess @ W),
    )

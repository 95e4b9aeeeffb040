"""Reports are made: of a step, after the switches around it, and with its ledger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from rigidfx.base.named import Named
from rigidfx.base.types import Array
from rigidfx.effects import Contact, Joint, JointReports, Rigid, SpringDamper, Touch
from rigidfx.flexible.strain_rate import Indicator
from rigidfx.report.events import Event
from rigidfx.report.probe_stress import Probes
from rigidfx.report.report import Report
from rigidfx.scene.scene import Scene
from rigidfx.shapes.shortening import Shortening
from rigidfx.state import State
from rigidfx.step.equations.energies import Measures
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import Impact
from rigidfx.step.system.system import StepResult
from rigidfx.withheld.recovery import Recovery


class Reported(Protocol):
    """The maker of a step, or a load step."""

    @property
    def scene(self) -> Scene:
        """The problem."""

    @property
    def state(self) -> State:
        """The state."""

    @property
    def indicator(self) -> Indicator | None:
        """Indicator of flexible cells, if any."""

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""

    def measure(self) -> Measures:
        """Energies and momenta. Collective."""


def report_of(
    step: int,
    stepper: Reported,
    probes: Probes,
    result: StepResult | None,
    impact: Impact | None,
    shortening: Shortening | None = None,
    recovery: Recovery | None = None,
) -> Report:
    """The report of a step, or of the initial state. Collective.

    Args:
        step: Its number.
        stepper: Its maker.
        probes: Points that are reported.
        result: Result of the step; None for the initial state.
        impact: Impact of a support at the start of the step.
        shortening: Displacements of second order of bodies with shapes; not shown if None.
        recovery: Strains withheld from rigid parts, if known.
    """
    state, solution = stepper.state, result.solution if result else None
    u, v = _shown(probes, state, shortening)
    return Report(
        step=step,
        t=state.t,
        dt=result.dt if result else 0.0,
        iterations=solution.iterations if solution else 0,
        tangents=solution.tangents if solution else 0,
        residuals=solution.residuals if solution else (),
        linear_iterations=solution.linear_iterations if solution else 0,
        solver=solution.solver if solution else "",
        cuts=result.cuts if result else 0,
        unknowns=stepper.unknowns,
        **vars(stepper.measure()),
        work_of_loads=result.work_of_loads if result else 0.0,
        work_of_supports=result.work_of_supports if result else 0.0,
        dissipated=result.dissipated if result else {},
        **_acting(stepper.scene, result),
        impact=impact,
        alternating_impulse=result.alternating_impulse if result else np.zeros((2, 3)),
        rigid=state.bodies,
        clamped=_clamped(stepper),
        events=(),
        closeness=np.nan,
        probes=Named("report.probes", u),
        velocities=Named("report.velocities", v),
        ledger=None,
        wall=0.0,
        _state=state,
        _changes=state.changes,
        _indicator=stepper.indicator,
        _probes=probes,
        _shortening=shortening,
        _recovery=recovery,
    )


def amended(report: Report, stepper: Stepper, events: Sequence[Event], closeness: float) -> Report:
    """A report after the switches around its step. Collective."""
    changes = stepper.state.changes
    if not events and np.isnan(closeness) and report._changes == changes:
        return report
    report = replace(
        report,
        events=tuple(events),
        work_of_loads=report.work_of_loads + sum(e.work_of_motors for e in events),
        work_of_supports=report.work_of_supports + sum(e.work_of_supports for e in events),
        closeness=closeness,
        _changes=changes,
    )
    if not any(event.t == report.t for event in events):
        return report
    return replace(
        report,
        **vars(stepper.measure()),
        rigid=stepper.state.bodies,
        velocities=Named(
            "report.velocities", _shown(report._probes, stepper.state, report._shortening)[1]
        ),
    )


def _shown(
    probes: Probes, state: State, shortening: Shortening | None
) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
    """Displacement [m] and velocity [m/s] of each probe, with those of second order. Collective."""
    u, v = probes.displacements(state), probes.velocities(state)
    if shortening is None or not (more := shortening.at_probes(state.bodies)):
        return u, v
    return {k: u[k] + d for k, (d, _) in more.items()}, {k: v[k] + r for k, (_, r) in more.items()}


def _acting(scene: Scene, result: StepResult | None) -> dict[str, Any]:
    """Reactions, touches, joints and springs of a step, or of the initial state, by name."""
    if result is None:
        titles = [joint.title for joint in scene.named(Joint)]
        touches = {contact.title: Touch(contact.title) for contact in scene.named(Contact)}
        acting = held_at_start(scene, {}, {}) | {"joints": JointReports(later=titles)}
        springs, later = {}, [spring.title for spring in scene.named(SpringDamper)]
    else:
        touches, springs, later = dict(result.touches), dict(result.spring_dampers), []
        acting = {
            "reactions": Named("report.reactions", result.reactions),
            "reaction_moments": Named("report.reaction_moments", result.reaction_moments),
            "joints": result.joints,
        }
    acting["spring_dampers"] = Named("report.spring_dampers", springs, later)
    return acting | {"touches": Named("report.touches", touches)}


def held_at_start(
    scene: Scene, forces: Mapping[str, Array], moments: Mapping[str, Array]
) -> dict[str, Any]:
    """Reactions of the initial state; those that are missing are known after the first step.

    Args:
        scene: The problem.
        forces: Force of each support that a static preload knows, by its name [N].
        moments: Their moments about the origin [N m].
    """
    acting = (support for support, _ in scene.supports if support.acts(0.0))
    later = dict.fromkeys(s.where for s in acting if s.where not in forces)
    return {
        "reactions": Named("report.reactions", forces, later),
        "reaction_moments": Named("report.reaction_moments", moments, later),
    }


def _clamped(stepper: Reported) -> tuple[str, ...]:
    """Names of the parts that supports hold; they are numbered as the scene names them."""
    if not stepper.state.clamped:
        return ()
    named = stepper.scene.named(Rigid)
    return tuple(named[number - 1].name for number in sorted(stepper.state.clamped))

"""Reports are made: of a step, after the switches around it, and with its ledger."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rigidfx.base.named import Named
from rigidfx.base.types import Array
from rigidfx.effects import Contact, Joint, JointReports, Rigid, SpringDamper, Touch
from rigidfx.report.events import Event
from rigidfx.report.probe_stress import Probes
from rigidfx.report.report import Report, Source
from rigidfx.scene.scene import Scene
from rigidfx.shapes.shortening import Shortening
from rigidfx.state import State
from rigidfx.step.equations.supports import Impact
from rigidfx.step.load_path import LoadPath
from rigidfx.step.newton.newton import Solution
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.system import StepResult
from rigidfx.withheld.recovery import Recovery


def report_of(
    step: int,
    stepper: Stepper | LoadPath,
    probes: Probes,
    result: StepResult | None,
    impact: Impact | None,
    shortening: Shortening | None = None,
    recovery: Recovery | None = None,
) -> Report:
    """The report of a step, or of the initial state, which has no result. Collective.

    An impact is that of a support at the start; a shortening is that of bodies with shapes, by
    displacements of second order.
    """
    state = stepper.state
    u, v = _shown(probes, state, shortening)
    # Parts that supports hold are numbered as the scene names them.
    named = stepper.scene.named(Rigid) if state.clamped else ()
    return Report(
        step=step,
        t=state.t,
        unknowns=stepper.unknowns,
        energies=stepper.measure(),
        result=_at_start(stepper.scene) if result is None else _named(result),
        impact=impact,
        rigid=state.bodies,
        clamped=tuple(named[number - 1].name for number in sorted(state.clamped)),
        probes=Named("report.probes", u),
        velocities=Named("report.velocities", v),
        _source=Source(state, state.changes, stepper.indicator, probes, shortening, recovery),
    )


def amended(report: Report, stepper: Stepper, events: Sequence[Event], closeness: float) -> Report:
    """A report after the switches around its step. Collective."""
    changes, source = stepper.state.changes, report._source
    if not events and np.isnan(closeness) and source.changes == changes:
        return report
    loads = report.work_of_loads + sum(event.work_of_motors for event in events)
    supports = report.work_of_supports + sum(event.work_of_supports for event in events)
    report = replace(
        report,
        events=tuple(events),
        result=replace(report.result, work_of_loads=loads, work_of_supports=supports),
        closeness=closeness,
        _source=replace(source, changes=changes),
    )
    if not any(event.t == report.t for event in events):
        return report
    _, v = _shown(source.probes, stepper.state, source.shortening)
    return replace(
        report,
        energies=stepper.measure(),
        rigid=stepper.state.bodies,
        velocities=Named("report.velocities", v),
    )


def _shown(
    probes: Probes, state: State, shortening: Shortening | None
) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
    """Displacement [m] and velocity [m/s] of each probe, with those of second order. Collective."""
    u, v = probes.displacements(state), probes.velocities(state)
    if shortening is None or not (more := shortening.at_probes(state.bodies)):
        return u, v
    return {k: u[k] + d for k, (d, _) in more.items()}, {k: v[k] + r for k, (_, r) in more.items()}


def _named(result: StepResult) -> StepResult:
    """A result whose mappings name what a report has under a wrong name."""
    names = "reactions", "reaction_moments", "touches", "spring_dampers"
    named: dict[str, Any] = {n: Named(f"report.{n}", getattr(result, n)) for n in names}
    return replace(result, **named)


def _at_start(scene: Scene) -> StepResult:
    """The result of no step, for the initial state."""
    touches = {contact.title: Touch(contact.title) for contact in scene.named(Contact)}
    springs = [spring.title for spring in scene.named(SpringDamper)]
    reactions, moments = _held(scene, {}, {})
    return StepResult(
        work_of_loads=0.0,
        work_of_supports=0.0,
        dissipated={},
        reactions=reactions,
        reaction_moments=moments,
        alternating_impulse=np.zeros((2, 3)),
        touches=Named("report.touches", touches),
        joints=JointReports(later=[joint.title for joint in scene.named(Joint)]),
        spring_dampers=Named("report.spring_dampers", {}, springs),
        dt=0.0,
        solution=Solution(True, "", (), 0, 0, "", None, 0.0, 0.0, 0.0),
        cuts=0,
    )


def preloaded(
    report: Report, scene: Scene, forces: Mapping[str, Array], moments: Mapping[str, Array]
) -> Report:
    """The report of the initial state with forces [N] of supports, and their moments [N m]."""
    reactions, moments = _held(scene, forces, moments)
    result = replace(report.result, reactions=reactions, reaction_moments=moments)
    return replace(report, result=result)


def _held(
    scene: Scene, forces: Mapping[str, Array], moments: Mapping[str, Array]
) -> tuple[Named[Array], Named[Array]]:
    """Reactions of the initial state; those that are missing are known after the first step."""
    acting = (support for support, _ in scene.supports if support.acts(0.0))
    later = dict.fromkeys(s.where for s in acting if s.where not in forces)
    return (
        Named("report.reactions", forces, later),
        Named("report.reaction_moments", moments, later),
    )

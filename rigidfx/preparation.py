"""How a run is prepared, up to its first step."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from petsc4py import PETSc

from rigidfx.base.failures import Failures
from rigidfx.decide.criteria.heeded import heeded_indicator
from rigidfx.decide.criteria.judging import Criterion
from rigidfx.decide.policy import Policy
from rigidfx.error.ending import Promise
from rigidfx.error.error_motion import ErrorMotion
from rigidfx.error.looks import Looks, can_be_followed, can_decide
from rigidfx.flexible.indicator import Indicator
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.report.ledger import Ledgers
from rigidfx.report.probes import Probes
from rigidfx.report.start import Start
from rigidfx.run import Run
from rigidfx.scene.scene import Scene
from rigidfx.scene.step_control import StepControl
from rigidfx.scene.timeline import Timeline
from rigidfx.shadow.body_forces import BodyForces
from rigidfx.shadow.recovery import Recovery
from rigidfx.shadow.shadow import Shadow
from rigidfx.shadow.shadows import Shadows
from rigidfx.shadow.subjects import FreeBodies, HeldParts, Subjects
from rigidfx.state import State
from rigidfx.step.first_touch import FirstTouch
from rigidfx.step.length.time_control import TimeControl
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.supports import Impact
from rigidfx.switch.switch import Switch

__all__ = ["prepare"]


def prepare(
    scene: Scene,
    timeline: Timeline,
    rigidify: Criterion | None = None,
    control: StepControl | None = None,
    start: Start | None = None,
    bring_back: Callable[[State, Switch], None] | None = None,
) -> tuple[Run, Impact | None]:
    """Prepare a run up to its first step; its stepper is to be closed. Collective.

    Args:
        scene: The problem.
        timeline: Where steps end.
        rigidify: When parts become rigid and flexible again; no part does if None.
        control: How Δt is chosen; the timeline says it if None.
        start: Where the run begins; as the scene says if None.
        bring_back: Has the state and the division of a checkpoint in place of a start; collective.

    Returns:
        The run, and the velocity that supports have imposed at the start, if they have.

    Raises:
        SceneError: If the initial state is in conflict.
        StepError: If a static preload does not converge.
    """
    PETSc.garbage_cleanup(scene.comm)  # of runs that were given up
    for support, _ in scene.supports:
        support.check_run(scene, timeline.t_end)
    probes, state = Probes(scene), State(scene)
    starts = {0.0, *(t for t in scene.breakpoints if t > 0)}
    acting = [scene.acting(timeline.after(t)) for t in sorted(starts, reverse=True)]
    forces, failures = InternalForces(scene, state.u, acting), Failures(scene.comm)
    indicator = None if rigidify is None else heeded_indicator(rigidify, scene, forces, failures)
    chooses = None if control is None else TimeControl(scene, control, timeline)
    stepper = Stepper(scene, state, forces, indicator, chooses, failures)
    with ExitStack() as stack:
        stack.callback(stepper.close)
        switch = Switch(stepper, timeline, start)
        impact = None
        if bring_back is None:
            impact = switch.begin()
        else:
            bring_back(state, switch)
        policy = None
        if rigidify is not None:
            measure = heeded_indicator(rigidify, scene, forces, failures)
            policy = Policy(scene, rigidify, timeline, failures, measure, can_decide(scene))
        shadows = error = looks = None
        if rigidify is not None and policy is not None and rigidify.wake == "local":
            measures = partial(heeded_indicator, rigidify, scene, forces, failures)
            settling, clamps = rigidify.settling, switch.clamps
            shadows = _shadows(stepper, policy, measures, settling, clamps)
            if can_be_followed(scene):
                promise = Promise(rigidify.allowed, policy.rule.length)
                error, looks = _followed(stepper, policy, shadows.free, measures, probes, promise)
        ledgers = None if shadows is None and control is None else Ledgers(stepper)
        stack.pop_all()
    touch = FirstTouch(stepper)
    run = Run(timeline, stepper, switch, policy, probes, shadows, touch, ledgers, error, looks)
    return run, impact


def _shadows(
    stepper: Stepper,
    policy: Policy,
    measures: Callable[[], Indicator],
    settling: float,
    clamps: bool,
) -> Shadows:
    """What knows the forces on rigid parts; the stepper's watches have it, too. Collective.

    Args:
        stepper: Solves the steps.
        policy: Knows what tells what wakes.
        measures: Makes a measure of cells.
        settling: Time in which a drag takes the shadows' vibration out [s].
        clamps: Whether supports hold parts named rigid at any time.
    """

    def shadow_of(subjects: Subjects) -> Shadow:
        return Shadow(stepper, subjects, measures(), settling)

    pieces, free = policy.named.in_pieces, None
    bodies = FreeBodies(stepper, pieces)
    free = BodyForces(stepper, bodies) if policy.by_error else shadow_of(bodies)
    held = shadow_of(HeldParts(stepper, pieces)) if clamps else None
    stepper.watches += [watch for watch in (free, held) if watch is not None]
    return Shadows(free, held, Recovery(stepper))


def _followed(
    stepper: Stepper,
    policy: Policy,
    forces: Shadow | BodyForces,
    measures: Callable[[], Indicator],
    probes: Probes,
    promise: Promise,
) -> tuple[ErrorMotion, Looks | None]:
    """The error motion, and what asks it which cells wake; the watches have both. Collective.

    Args:
        stepper: Solves the steps.
        policy: Says whether it decides: it takes the steps of the run, then.
        forces: Knows ρ.
        measures: Makes a measure of cells.
        probes: Points that are reported.
        promise: What e may be.
    """
    strokes, looks = policy.memory.strokes, None
    turning = (lambda: 0.0) if policy.by_error else (lambda: strokes.time)
    error = ErrorMotion(stepper, forces, turning, probes.points, measures(), promise)
    stepper.watches.append(error)
    if isinstance(forces, BodyForces):
        looks = Looks(stepper, forces, error, measures())
        stepper.watches.append(looks)
    return error, looks

"""How a run is prepared, up to its first step."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

from petsc4py import PETSc

from rigidfx.base.errors import together
from rigidfx.base.uncaught import on_all_ranks
from rigidfx.decide.policy import Policy
from rigidfx.decide.settings import Criterion
from rigidfx.effects import Contact, Rigid
from rigidfx.flexible.internal_forces import InternalForces
from rigidfx.flexible.strain_rate import Indicator
from rigidfx.growth.growth import Growth
from rigidfx.mechanics.rigid_body import Body
from rigidfx.report.ledger import Ledgers, Rigidity
from rigidfx.report.probe_stress import Probes
from rigidfx.report.resolved_forces import ResolvedForces
from rigidfx.report.start import Start
from rigidfx.run import Run
from rigidfx.scene.scene import Scene
from rigidfx.scene.timeline import StepControl, Timeline
from rigidfx.shapes.excess import About
from rigidfx.shapes.shortening import Shortening
from rigidfx.state import State
from rigidfx.step.equations.supports import Impact
from rigidfx.step.first_touch import FirstTouch
from rigidfx.step.length.time_control import TimeControl
from rigidfx.step.stepper import Stepper
from rigidfx.switch.switch import Switch
from rigidfx.withheld.body_forces import BodyForces
from rigidfx.withheld.held_parts import HeldParts
from rigidfx.withheld.recovery import Recovery


def prepare(
    scene: Scene,
    timeline: Timeline,
    rigidify: Criterion | None = None,
    control: StepControl | None = None,
    start: Start | None = None,
    bring_back: Callable[[State, Switch], None] | None = None,
    *,
    idle: Rigidity | None = None,
) -> tuple[Run, Impact | None]:
    """Prepare a run up to its first step, with the impact of supports at the start. Collective.

    Its stepper is to be closed. Without a control the timeline says where steps end. A checkpoint
    has its state and division brought back in place of a start.

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
    forces = InternalForces(scene, state.u, acting)
    indicator = None if rigidify is None else _measure(scene, rigidify, forces)
    chooses = None if control is None else TimeControl(scene, control, timeline)
    stepper = Stepper(scene, state, forces, indicator, chooses)
    with ExitStack() as stack:
        stack.push(lambda kind, *_: stepper.close() if on_all_ranks(scene.comm, kind) else None)
        switch = Switch(stepper, timeline, start)
        impact = None
        if bring_back is None:
            impact = switch.begin()
        else:
            bring_back(state, switch)
        policy = recovery = growth = None
        if rigidify is not None:
            policy = Policy(scene, rigidify, timeline)
            if rigidify.grows:
                pieces = policy.named.in_pieces
                borne = BodyForces(stepper, pieces)
                measure = _measure(scene, rigidify, forces)
                growth = Growth(stepper, borne, measure, timeline.dt)
                switch.shape_found(growth.found)
                stepper.watches += [borne, growth]
                if scene.named(Rigid):
                    held = HeldParts(stepper, pieces) if switch.clamps else None
                    stepper.watches += [] if held is None else [held]
                    recovery = Recovery(stepper, borne, held)
        ledgers = None if control is None else Ledgers(stepper)
        stack.pop_all()
    touch, contacts = FirstTouch(stepper), ResolvedForces(scene) if scene.named(Contact) else None
    about = partial(_about, switch, growth)
    shortening = Shortening(scene, probes.points, about, partial(_allowed, policy, chooses))
    known = policy, probes, shortening, recovery, touch, contacts, ledgers
    return Run(timeline, stepper, switch, *known, idle, growth), impact


def _allowed(policy: Policy | None, control: TimeControl | None) -> float:
    """By how much displacements may err for bodies; zero where none is bounded [m]."""
    limits = None if policy is None else policy.rule.limits()
    if control is None or limits is None or limits.rates is not None:
        return 0.0
    return limits.part * control.reach(0.0)


def _about(switch: Switch, growth: Growth | None, body: Body) -> About:
    """The expansion of a body with shapes. Collective."""
    found = None if growth is None else growth.found.about(body)
    return switch.shaping.about(body) if found is None else found


def _measure(scene: Scene, criterion: Criterion, forces: InternalForces) -> Indicator:
    """The indicator of a criterion. Collective."""
    owner = f"{criterion.owner}: its indicator"
    return together(scene.comm, owner, partial(criterion.indicator, scene, forces))

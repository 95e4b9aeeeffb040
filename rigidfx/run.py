"""The parts of a run, and their calls before and after a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rigidfx.base.matrices import free
from rigidfx.base.remembered import PART, Remembered
from rigidfx.base.uncaught import on_all_ranks
from rigidfx.decide.bodies import Decision
from rigidfx.decide.limits import Limits
from rigidfx.decide.policy import Policy
from rigidfx.decide.rules import Observation
from rigidfx.growth.found_bodies import Looked
from rigidfx.growth.growth import Growth
from rigidfx.report.events import Event
from rigidfx.report.ledger import Ledgers, Rigidity
from rigidfx.report.of_step import report_of
from rigidfx.report.probe_stress import Probes
from rigidfx.report.report import Report
from rigidfx.report.resolved_forces import ResolvedForces
from rigidfx.scene.timeline import Timeline
from rigidfx.shapes.shortening import Shortening
from rigidfx.step.first_touch import FirstTouch
from rigidfx.step.stepper import Stepper
from rigidfx.step.system.system import StepResult
from rigidfx.step.watches.judge import Attempt
from rigidfx.switch.switch import Switch
from rigidfx.withheld.recovery import Recovery


@dataclass(frozen=True)
class Run:
    """The parts of a run."""

    timeline: Timeline  # where steps end
    stepper: Stepper  # makes steps
    switch: Switch  # applies decisions, and follows effects that begin or end
    policy: Policy | None  # decides on rigid and flexible cells; None if nothing does
    probes: Probes  # points that are reported
    shortening: Shortening  # displacements of second order of bodies with shapes
    recovery: Recovery | None  # strains of parts named rigid; None if they are not asked for
    touch: FirstTouch  # foresees the first touch of a contact
    # Averages forces of contacts over the time that the mesh resolves; None without
    resolved: ResolvedForces | None
    ledgers: Ledgers | None  # spent accuracy; None if nothing estimates it
    # Error of the motion by rigid parts where nothing may become rigid, if that is told
    idle: Rigidity | None
    growth: Growth | None  # gives bodies that were found shapes; None if they stay rigid

    remembered: ClassVar[Remembered] = dict.fromkeys(
        ("stepper", "policy", "shortening", "touch", "resolved", "ledgers", "growth"), PART
    )

    def target(self) -> float:
        """Time at which the next step is to end [s]."""
        t, control = self.stepper.state.t, self.stepper.control
        return self.timeline.next(t) if control is None else control.target(t)

    def advance(self, target: float, number: int = 0) -> tuple[StepResult, list[Event]]:
        """Advance to the target time [s], or towards it; where bodies wake, once more. Collective.

        The outcome of the step of a number, and its events, are returned.
        """
        stepper, policy = self.stepper, self.policy
        self.switch.renew()
        attempt = stepper.attempt(target)
        while self.switch.grow(attempt.dt):
            attempt = stepper.attempt(attempt.end, again=True)
        if policy is None:
            return stepper.accept(attempt), []
        attempt, found = self._grown(attempt, policy.rule.limits)
        seen = Observation(stepper, attempt.dt, 0.0)
        decision = policy.struck(seen, stepper.touches)
        if decision is None and found.woken is not None:
            decision = policy.outgrown(seen, found.woken, found.reason)
        events = self._switched(policy, decision, seen)
        if not events and policy.releases.repeat and len(stepper.state.bodies):
            events = self._asked(policy, attempt, number)
        if events:
            attempt, _ = self._grown(stepper.attempt(attempt.end, again=True), None)
        return stepper.accept(attempt), events

    def _grown(
        self, attempt: Attempt, limits: Callable[[], Limits] | None
    ) -> tuple[Attempt, Looked]:
        """A step made again until bodies have the shapes that it calls for; which cells wake.

        Without limits, nodes that press are what calls for shapes, and no cell wakes. Collective.
        """
        if self.growth is None:
            return attempt, Looked()
        found = self.growth.look(attempt, limits)
        while found.bodies is not None:
            self.switch.regroup(found.bodies)
            attempt = self.stepper.attempt(attempt.end, again=True)
            found = self.growth.look(attempt, limits)
        return attempt, found

    def _asked(self, policy: Policy, attempt: Attempt, number: int) -> list[Event]:
        """Apply releases on a user's conditions before the step is solved again. Collective."""
        stepper = self.stepper
        with stepper.foreseen(attempt) as result:
            report = report_of(number, stepper, self.probes, result, None, self.shortening)
            bodies = stepper.state.bodies.of.records
            _, cells = policy.releases.asked(report.t, report, bodies, before=True)
        seen = Observation(stepper, attempt.dt, 0.0)
        return self._switched(policy, policy.repeated(seen, cells), seen)

    def __enter__(self) -> Run:
        """Nothing to do: its values were made before."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *of_error: object) -> None:
        """Free PETSc's objects of the run. Collective, but for runs that are given up.

        One rank alone may give up, as its script fails, and would wait here for the others. Its
        objects are PETSc's garbage then, until all ranks prepare a run again.
        """
        if on_all_ranks(self.stepper.scene.comm, kind):
            if self.recovery is not None:
                whole = kind in (None, GeneratorExit)
                (self.recovery.remember if whole else self.recovery.forget)()
            self.stepper.close()
            free(self.recovery, self.switch.shaping, self.growth)

    def ahead(self, target: float) -> list[Event]:
        """Decide before a step and switch; the events. Collective."""
        state, policy = self.stepper.state, self.policy
        if policy is None:
            return []
        seen = Observation(self.stepper, target - state.t, 0.0)
        return self._switched(policy, policy.ahead(seen, (state.t + target) / 2), seen)

    def after(self, report: Report) -> tuple[list[Event], float]:
        """Decide after a step and switch; the events, and how close it was. Collective."""
        policy = self.policy
        if policy is None:
            return [], np.nan
        lacked = 0.0 if self.growth is None else self.growth.size()
        seen = Observation(self.stepper, report.dt, lacked)
        policy.observe(seen)
        decision = policy.after(seen, report)
        if decision is not None and self.recovery is not None:
            self.recovery.remember()
        closeness = np.nan if decision is None else decision.closeness
        return self._switched(policy, decision, seen), closeness

    def accounted(self, report: Report) -> Report:
        """A report with its ledger, if there is one, ν, and resolved forces. Collective."""
        if self.resolved is not None:
            report = self.resolved.of(report)
        found = {} if self.growth is None else self.growth.found.nu
        if nu := self.switch.shaping.followed(self.stepper.state) | found:
            report = replace(report, nu=nu)
        if self.ledgers is None:
            return report
        periods, rigidity = (0.0, self.idle) if self.policy is None else self.policy.spent(report.t)
        if self.stepper.control is not None and rigidity is not None:
            length = self.stepper.control.length
            length.tol, length.error.theirs = rigidity.rest, rigidity.motion * length.displacement
        ledger = self.ledgers.follow(report, periods, rigidity)
        return replace(report, ledger=ledger)

    def _switched(
        self, policy: Policy, decision: Decision | None, seen: Observation
    ) -> list[Event]:
        if decision is None:
            return []
        event = self.switch.apply(decision)
        policy.applied(decision, seen, event is not None)
        return [] if event is None else [event]

"""A policy decides, and changes nothing by that; it remembers what it is told, and when."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

import rigidfx as rf
from rigidfx.decide.criteria.observation import Observation
from rigidfx.preparation import prepare
from rigidfx.report.of_step import report_of
from rigidfx.scene.timeline import Timeline

pytestmark = pytest.mark.filterwarnings("ignore:StrainRate. the window:rigidfx.RigidfxWarning")

MATERIAL = rf.StVenantKirchhoff(rho=1.0, E=300.0, nu=0.3)
ANY = 1e9  # 1/s; every cell qualifies
DT, WINDOW = 0.1, 0.25  # s; a window ends with its third step
SPIN = rf.InitialVelocity(linear=(0.3, 0.2, -0.1), angular=(0.3, 0.2, 0.5))
# Grows from 1 s on by a tenth of its largest value each 0.1 s.
GROWING = rf.NodalForce("x1", (0.0, 0.1, 0.0), time=rf.Table([1.0, 2.0], [1.0, 2.0]))
JUMPING = rf.NodalForce("x1", (0.0, 0.1, 0.0), since=0.7)


def bar(*effects, **options):
    """Eight cells in a row, with names for some at its ends."""
    domain = (
        rf.box((0, 0, 0), (8, 1, 1), (8, 1, 1))
        .with_cells("left", lambda x: x[0] < 3 + 1e-9)
        .with_cells("tip", lambda x: x[0] > 6 - 1e-9)
    )
    return rf.Scene(domain, MATERIAL, [SPIN, *effects], **options)


def contents(value):
    """Whatever it is, as something that can be compared."""
    if isinstance(value, np.ndarray):
        return contents(value.tolist())
    if isinstance(value, (list, tuple)):
        return [contents(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: contents(getattr(value, name)) for name in value.__dataclass_fields__}
    return "nan" if isinstance(value, float) and np.isnan(value) else value


class Told:
    """A run whose policy is asked, and told, by a test.

    Attributes:
        run: The run.
        policy: Its policy.
        report: That of the last step.
    """

    def __init__(self, run, timeline):
        self.run, self.policy, self.timeline = run, run.policy, timeline
        self.steps, self.report = 0, None

    @property
    def state(self):
        return self.run.stepper.state

    def seen(self):
        return Observation(self.run.stepper, DT)

    def step(self):
        """Make a step of which the policy knows nothing yet."""
        target = self.timeline.next(self.state.t)
        self.run.switch.follow_effects(target - self.state.t)
        result = self.run.stepper.advance(target)
        self.steps += 1
        self.report = report_of(self.steps, self.run.stepper, self.run.probes, result, None)

    def ahead(self):
        middle = (self.state.t + self.timeline.next(self.state.t)) / 2
        return self.policy.ahead(self.seen(), middle)

    def after(self):
        return self.policy.after(self.seen(), self.report)

    def apply(self, decision):
        """Apply it and tell the policy; what happened."""
        event = self.run.switch.apply(decision)
        self.policy.applied(decision, self.seen(), event is not None)
        return event

    def until(self, t):
        """Steps, each told and decided upon; what happened."""
        events = []
        while self.state.t < t - 1e-9:
            for ask in (self.ahead, self.step, self.after):
                if ask == self.after:
                    self.policy.observe(self.seen())
                decision = ask()
                events += [] if decision is None else [self.apply(decision)]
        return [event for event in events if event is not None]

    def memory(self):
        """All that is remembered, but for warnings that have been given."""
        memory = self.policy.memory
        window, back_off, loads = memory.window, memory.back_off, memory.loads
        return contents(
            [
                [window.start, window.steps, window.worst],
                [back_off.hasty, back_off.windows, back_off.observed, back_off.rigid_since],
                [loads.reference, loads.largest],
                memory.next_number,
            ]
        )

    def world(self):
        """All of the run that a policy sees."""
        state, stepper = self.state, self.run.stepper
        t, ends = state.t, []
        for _ in range(30):
            t = min(self.timeline.next(t), self.timeline.t_end - DT)
            ends.append(t)
        return contents(
            [
                state.t,
                state.u.x.array,
                state.v.x.array,
                [id(body) for body in state.bodies.of.records],
                state.bodies.pose,
                state.bodies.rates,
                id(stepper.system),
                stepper.indicator.values,
                ends,
            ]
        )


@contextmanager
def told(scene, window=WINDOW, tol=ANY, **options):
    """A run with a policy, by the paper's rule: nobody looks at what forces would strain here."""
    timeline = Timeline(DT, 100.0)
    run, _ = prepare(scene, timeline, rf.StrainRate(tol, window, wake="all", **options))
    timeline.stop_at(scene.breakpoints)
    with run:
        yield Told(run, timeline)


# Deciding --------------------------------------------------------------------------------------


def test_deciding_changes_nothing():
    """Not before a step, nor after it, nor the second time; of all kinds of decisions."""
    made = set()
    with told(bar(GROWING), release=rf.Release(at=0.75)) as run:
        while run.state.t < 1.6:
            for ask in (run.ahead, run.step, run.after):
                if ask == run.step:
                    ask()
                    run.policy.observe(run.seen())
                    continue
                memory, world = run.memory(), run.world()
                decision = ask()
                assert contents(ask()) == contents(decision)
                assert run.memory() == memory
                assert run.world() == world
                if decision is not None:
                    made.add((decision.kind, decision.reason.split(" on ")[0][:12]))
                    run.apply(decision)
                    assert run.memory() != memory
    assert made == {
        ("freeze", "strain rates"),
        ("release", "planned"),
        ("release", "a load or a "),  # the kink of the force
        ("release", "NodalForce"),
    }


@pytest.mark.parametrize(("window", "end"), [(WINDOW, 3.0), ("auto", 25.0)])
def test_decisions_do_not_depend_on_questions(window, end):
    """Whoever asks now and then in between is told, in the end, what others are."""
    stories = []
    for asks in (0, 2):
        with told(bar(GROWING), window, patience=1.0) as run:
            decisions = []
            while run.state.t < end:
                for _ in range(asks):
                    run.ahead()
                    run.policy.ahead(run.seen(), run.state.t + 5.0)
                if run.report is not None:
                    for _ in range(asks):
                        run.after()
                for ask in (run.ahead, run.step, run.after):
                    if ask == run.step:
                        run.step()
                        run.policy.observe(run.seen())
                    elif (decision := ask()) is not None:
                        decisions.append((run.state.t, contents(decision)))
                        run.apply(decision)
            stories.append(decisions)
    assert {decision["kind"] for _, decision in stories[0]} == {"freeze", "release"}
    assert stories[0] == stories[1]


def test_a_decision_that_is_not_applied_is_taken_again():
    """By the next step, with one more step in the window."""
    with told(bar()) as run:
        for _ in range(3):
            assert run.ahead() is None
            run.step()
            run.policy.observe(run.seen())
        first = run.after()
        run.step()
        run.policy.observe(run.seen())
        second = run.after()
        assert first.kind == second.kind == "freeze"
        assert contents(first.bodies) == contents(second.bodies)
        assert first.next_number == second.next_number == 2
        assert first.loads_at < second.loads_at


def test_before_and_after_its_time_nothing_is_frozen():
    """Observation begins at `since`, and ends at `until`."""
    with told(bar(), since=0.4, until=1.0) as run:
        events = run.until(0.6)
        assert run.policy.memory.window.start == 0.4
        assert run.policy.memory.window.steps == 2
        assert events == []
        (event,) = run.until(0.75)
        assert (event.kind, event.t) == ("freeze", pytest.approx(0.7))
    with told(bar(), since=0.4, until=0.65) as run:
        assert run.until(1.2) == []


@pytest.mark.parametrize("given", [True, False], ids=["given mass", "loaded as such"])
def test_bodies_apart_are_not_decided_on(given):
    """A body of given mass, or with a load on it as such, stays whatever happens."""
    tip = [rf.Rigid("tip", mass=5.0)] if given else [rf.Rigid("tip"), rf.Resultant("tip")]
    with told(bar(rf.Rigid("left"), *tip, JUMPING)) as run:
        (body,) = (b for b in run.state.bodies.of.records if b.name == "tip")
        # The other one grows up to the last flexible cell beside it, and shrinks again.
        for t, kind, cells in ((0.35, "freeze", 5), (0.75, "release", 3)):
            (event,) = run.until(t)
            assert event.kind == kind
            records = {b.name: b for b in run.state.bodies.of.records}
            assert records["tip"] is body
            assert records["left"].size == cells
            assert {change.name for change in event.changes} == {"left"}
            assert np.isnan(run.policy.memory.back_off.rigid_since[body.cells]).all()


# What is remembered ----------------------------------------------------------------------------

"""What remembers takes notice of steps only, once each, in one call."""

from __future__ import annotations

import numpy as np

import rigidfx as rf
from rigidfx.preparation import prepare
from rigidfx.scene.timeline import Timeline
from rigidfx.step.watches.judge import Watch


class Notes(Watch):
    """Notes where the state was, and what the forms held, at each acceptance."""

    def __init__(self, stepper):
        self.stepper, self.seen = stepper, []

    def accept(self, attempt):
        state, forces = self.stepper.state, self.stepper.forces
        moved = np.abs(forces.u1.x.array - forces.u0.x.array).max()
        self.seen.append((attempt.t, attempt.end, attempt.cuts, state.t, moved > 0))


def test_attempts_that_are_cut_leave_no_trace():
    """A push that turns a cell inside out in whole steps: two of three attempts are cut."""
    soft = rf.NeoHooke(E=1e3, nu=0.3, rho=10.0)
    scene = rf.Scene(
        rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1)), soft, [rf.Traction("x1", (-4e3, 0, 0))]
    )
    timeline = Timeline(0.4, 0.4)
    run, _ = prepare(scene, timeline)
    with run:
        notes = Notes(run.stepper)
        run.stepper.watches.append(notes)
        ends, cuts = [], 0
        while not timeline.over(run.stepper.state.t):
            result, _ = run.advance(timeline.next(run.stepper.state.t))
            ends.append(run.stepper.state.t)
            cuts += result.cuts
    assert cuts > 0
    assert [end for _, end, *_ in notes.seen] == ends
    assert [t for t, *_ in notes.seen] == [0.0, *ends[:-1]]
    assert all(t == start and moved for t, _, _, start, moved in notes.seen)

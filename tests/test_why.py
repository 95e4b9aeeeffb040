"""Attempts at a step: what they leave, why they have no solution, loads beyond the material."""

import numpy as np
import pytest

import rigidfx as rf
from rigidfx.preparation import prepare
from rigidfx.scene.timeline import Timeline
from rigidfx.step.newton.newton import Solution
from rigidfx.step.watches.judge import Watch, overload

MATERIAL = rf.StVenantKirchhoff(E=1e4, nu=0.0, rho=10.0)  # collapses under 0.19 E = 1925 Pa


def failed(*residuals, rounding=0.0):
    return Solution(False, "why", residuals, 1, 1, "LU", None, 0.0, 0.0, rounding)


@pytest.mark.parametrize(
    ("solution", "told"),
    [
        (failed(), "a force is not finite"),
        (failed(1.0, np.nan), "a force is not finite"),
        (failed(1.0, 3.0), "residuals grow"),
        (failed(3.0, 1.0), "residuals no longer fall"),
        (failed(1e-3, 2e-9, rounding=1e-9), "left is rounding: forces are known to 1.0e-09 N"),
    ],
)
def test_how_newtons_method_failed(solution, told):
    assert told in solution.course


def test_a_pressure_beyond_the_material_is_told():
    """By its size, in words of its own, where steps and load steps end; others are not blamed."""
    box = rf.box((0, 0, 0), (1, 1, 1), (1, 1, 1))
    pushed = rf.Pressure("x1", lambda t: 3e3 * t)
    scene = rf.Scene(box, MATERIAL, [rf.Fixed("x0"), pushed])
    blamed = "Pressure on 'x1' has .* Pa at t = 0.*of the stiffness.*more than it bears"
    with pytest.raises(rf.StepError, match=blamed):
        list(rf.static(scene, 5))
    with pytest.raises(rf.StepError, match=blamed):
        list(rf.simulate(scene, 0.05, 1.0, progress=False))
    assert overload(scene, 0.01) == ""
    little = rf.Scene(box, MATERIAL, [rf.Fixed("x0"), rf.Pressure("x1", 10.0)])
    assert overload(little, 0.5) == ""


def test_each_material_counts_where_the_pressure_is():
    box = rf.box((0, 0, 0), (2, 1, 1), (2, 1, 1))
    box = box.with_cells("soft", lambda x: x[0] < 1.01).with_cells("hard", lambda x: x[0] > 0.99)
    steel = rf.StVenantKirchhoff(E=1e9, nu=0.0, rho=10.0)
    of = {"soft": MATERIAL, "hard": steel}
    scenes = [rf.Scene(box, of, [rf.Pressure(name, 3e3)]) for name in ("x1", "x0")]
    assert [bool(overload(scene, 0.1)) for scene in scenes] == [False, True]


def test_a_step_at_rounding_is_told():
    """A bar of steel that 1 N pulls, of which one iteration leaves rounding; in statics, too."""
    box = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    steel = rf.StVenantKirchhoff(E=2e11, nu=0.3, rho=1000.0)
    scene = rf.Scene(box, steel, [rf.Fixed("x0"), rf.Traction("x1", (0, 0, 1.0))])
    once = {"petsc_options": {"snes_max_it": 1}}
    told = r"all that is left is rounding: forces are known to \d\.\de-04 N at best"
    for steps in (rf.static(scene, 2, **once), rf.simulate(scene, 0.01, 0.02, **once)):
        with pytest.raises(rf.StepError, match=told):
            list(steps)


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

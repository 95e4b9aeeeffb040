"""Effects that do not act now cost a step nothing: not one call."""

from __future__ import annotations

import sys

import pytest

import rigidfx as rf

LATER = {"since": 1e5}


def bar(*effects):
    """A bar that is pushed, maybe with a rigid half."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1)).with_cells("half", lambda X: X[0] >= 2 - 1e-9)
    steel = rf.StVenantKirchhoff(E=2e7, nu=0.3, rho=1000.0)
    push = rf.Traction("x1", (0, 0, 2e3))
    return rf.Scene(domain, steel, [rf.Fixed("x0"), push, *effects])


IDLE = [
    rf.Gravity(**LATER),
    rf.BodyForce((1.0, 0, 0), **LATER),
    rf.Traction("y0", (1.0, 0, 0), **LATER),
    rf.NodalForce("y1", (1.0, 0, 0), **LATER),
    rf.Pressure("z0", 1.0, **LATER),
    rf.Pressure("z1", 2.0, **LATER),
    rf.KelvinVoigt(1.0, **LATER),
    rf.MassDamping(0.1, **LATER),
    rf.NumericalDamping(0.1, **LATER),
    rf.PrescribedMotion("x1", displacement=lambda t: (0.0, 0.0, 0.0), **LATER),
]


def calls(scene, steps=4):
    """Calls of Python and of C in a run's steps, as the interpreter counts them, and iterations."""
    run = rf.simulate(scene, 0.01, 2e5)
    for _ in range(3):
        next(run)
    count = 0

    def note(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        iterations = [next(run).iterations for _ in range(steps)]
    finally:
        sys.setprofile(before)
    run.close()
    return count, iterations


@pytest.mark.parametrize("rigid", [(), (rf.Rigid("half"),)], ids=["flexible", "rigid"])
def test_ten_effects_that_do_not_act_cost_nothing(rigid):
    # The interpreter's own calls, of collected objects say, come now and then.
    without, beside = (min(calls(bar(*rigid, *idle)) for _ in range(3)) for idle in ((), IDLE))
    assert without == beside
    assert without[0] > 1000

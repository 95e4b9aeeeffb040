"""What a run says that rigid parts have saved."""

from __future__ import annotations

from types import SimpleNamespace

import rigidfx as rf
from rigidfx.report.pay import Pay


def steps(*rows):
    """What is said after steps of (unknowns, bodies, wall time, events)."""
    pay = Pay()
    for step, (unknowns, bodies, wall, events) in enumerate(rows):
        pay.follow(
            SimpleNamespace(
                step=step,
                dt=0.1,
                unknowns=unknowns,
                bodies=bodies * [None],
                wall=wall,
                events=events * [None],
            )
        )
    return pay.told()


def test_steps_with_bodies_are_compared_with_those_without():
    flexible, switch, rigid = (100, 0, 2.0, 0), (40, 1, 4.0, 1), (40, 1, 1.0, 0)
    said = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *19 * [rigid])
    assert said == (
        "rigid parts: 30% of unknowns × time; a step with them took 0.50 of one without; "
        "steps with a switch took 6% of the time"
    )
    dear = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *19 * [(40, 1, 3.0, 0)])
    assert "took 1.50 of one without, which does not pay" in dear
    assert steps((100, 0, 0.0, 0), *20 * [flexible]) == ""


def test_a_run_says_it_at_its_end(caplog):
    box = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    scene = rf.Scene(box, rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0), [rf.Fixed("x0")])
    with caplog.at_level("INFO", "rigidfx"):
        list(rf.simulate(scene, 0.1, 2.0, rigidify=rf.StrainRate(1.0, 0.5), progress=False))
    assert any("rigid parts:" in record.message for record in caplog.records)

"""What a run says that rigid parts have saved."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base.log import heard
from rigidfx.report.account import Account, Pay


def steps(*rows):
    """What is said after steps of (unknowns, bodies, wall time, events)."""
    pay = Pay()
    for step, (unknowns, bodies, wall, events) in enumerate(rows):
        pay.follow(report(step, bodies, wall, unknowns, events))
    return pay.told()


def report(step, bodies, wall, unknowns=None, events=0, named=0):
    """What is asked of one, with bodies found and parts named rigid."""
    found = [SimpleNamespace(name="part 2", cells=9, size=9, named=(), q=np.zeros(0))]
    parts = [SimpleNamespace(name="lug", cells=9, size=9, named=("lug",), q=np.zeros(0))]
    records = bodies * found + named * parts
    return SimpleNamespace(
        step=step,
        t=0.1 * step,
        dt=0.1,
        unknowns=(40 if bodies else 100) if unknowns is None else unknowns,
        bodies=records,
        rigid=SimpleNamespace(of=SimpleNamespace(records=records)),
        wall=wall,
        events=events * [None],
        iterations=1,
        cuts=0,
    )


def test_steps_with_bodies_are_compared_with_those_without():
    flexible, switch, rigid = (100, 0, 2.0, 0), (40, 1, 4.0, 1), (40, 1, 1.0, 0)
    said = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *19 * [rigid])
    assert said == (
        "rigid parts: 30% of unknowns × time; a step with them took 0.57 of one without; "
        "steps with a switch took 6% of the time"
    )
    dear = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *19 * [(40, 1, 3.0, 0)])
    assert "took 1.52 of one without, which does not pay" in dear
    assert steps((100, 0, 0.0, 0), *20 * [flexible]) == ""
    # Most steps are cheap; each tenth pays for the error motion, and switches cost what is saved.
    slow = [*9 * [(40, 1, 1.0, 0)], (40, 1, 12.0, 0)]
    dear = steps((100, 0, 0.0, 0), *20 * [flexible], switch, *3 * slow)
    assert "took 1.08 of one without, which does not pay" in dear


def test_what_does_not_pay_is_told_in_pipes(capsys):
    """As a line on standard error, where a run is not silent; what pays is told to who asks."""
    for dear, verbose, told in ((True, None, 1), (True, False, 0), (False, None, 0)):
        account = Account(MPI.COMM_SELF, 1.0)
        with heard(MPI.COMM_SELF, verbose), account:
            for step in range(40):
                account.follow(
                    report(step, step > 20, 3.0 if dear and step > 20 else 2.0 - step / 40)
                )
        assert capsys.readouterr().err.count("which does not pay") == told


def test_a_run_says_it_at_its_end(caplog):
    box = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    scene = rf.Scene(box, rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0), [rf.Fixed("x0")])
    with caplog.at_level("INFO", "rigidfx"):
        list(rf.simulate(scene, 0.1, 2.0, rigidify=rf.StrainRate(1.0, 0.5), progress=False))
    assert any("rigid parts:" in record.message for record in caplog.records)

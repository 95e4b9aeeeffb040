"""Histories of scenes with every effect, for as many ranks as there are."""

from __future__ import annotations

import sys

from balances import follow
from parallel import report
from test_effects import EFFECTS, SPIN, bar

import rigidfx as rf

rows = []
for parts in ([], [rf.Rigid("middle")], [rf.Rigid("end")]):
    # A body may not be held in part.
    effects = [e for e in EFFECTS.values() if not isinstance(e, rf.effects.Support)]
    scene = bar(*effects, SPIN, *parts, mass=sys.argv[1])
    books, reports = follow(scene, 0.1, 1.0)
    assert books.worst <= 1e-11, books
    for r in reports:
        rows.append(
            [
                r.kinetic,
                r.strain,
                r.springs,
                *r.linear_momentum,
                *r.angular_momentum,
                r.work_of_loads,
                sum(r.dissipated.values()),
            ]
        )
if scene.comm.rank == 0:
    report(rows)

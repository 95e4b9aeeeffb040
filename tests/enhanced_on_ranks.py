"""Histories of enhanced cells with every term of the forms, beside a body, on as many ranks."""

from __future__ import annotations

import numpy as np
from parallel import report
from test_enhanced import MATERIAL, SPIN, imbalance

import rigidfx as rf

rows = []
for mass in ("lumped", "consistent"):
    domain = rf.box((0, 0, 0), (6, 1, 1), (6, 2, 2)).with_cells("end", lambda x: x[0] > 4 - 1e-9)
    effects = [
        SPIN,
        rf.Rigid("end"),
        rf.Pressure("z0", 40.0),
        rf.KelvinVoigt(20.0),
        rf.NumericalDamping(0.05),
    ]
    scene = rf.Scene(domain, MATERIAL, effects, mass=mass, element="enhanced")
    reports = list(rf.simulate(scene, 0.05, 0.5))
    assert imbalance(reports) < 1e-11, imbalance(reports)
    for r in reports:
        lost = sum(r.dissipated.values())
        rows.append([r.kinetic, r.strain, *r.linear_momentum, *r.angular_momentum, lost])
if scene.comm.rank == 0:
    report(np.array(rows).tolist())

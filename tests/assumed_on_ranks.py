"""Histories of a thin curved part with every term of the forms, beside a body, on as many ranks."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from parallel import report
from test_assumed import bent, scene_of
from test_enhanced import SPIN, imbalance

import rigidfx as rf
from rigidfx.domain.thickness import thickness_axes

domain = bent((6, 4, 3), MPI.COMM_WORLD, turned=1)
owned = domain.mesh.topology.index_map(3).size_local
numbers = domain.mesh.topology.original_cell_index[:owned]
pairs = domain.comm.gather(np.c_[numbers, thickness_axes(domain, "outside")[:owned]])

domain = bent((6, 4, 1), MPI.COMM_WORLD, turned=2)
domain = domain.with_cells("end", lambda x: x[1] > 1.0)
effects = [
    SPIN,
    rf.Rigid("end"),
    rf.Pressure("outside", 3.0),
    rf.KelvinVoigt(20.0),
    rf.NumericalDamping(0.05),
]
reports = list(rf.simulate(scene_of(domain, *effects), 0.05, 0.5))
assert imbalance(reports) < 1e-11, imbalance(reports)
rows = []
for r in reports:
    lost = sum(r.dissipated.values())
    rows.append([r.kinetic, r.strain, *r.linear_momentum, *r.angular_momentum, lost])
if domain.comm.rank == 0:
    found = np.concatenate(pairs)
    report([found[np.argsort(found[:, 0])].tolist(), rows])

"""Histories of neo-Hooke cells, some thin, some enhanced, beside a body, on as many ranks."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from parallel import report
from test_projected import SOFT, spin, tube

import rigidfx as rf

domain = tube(MPI.COMM_WORLD).with_cells("end", lambda x: x[1] > 0.5)
effects = [spin(), rf.Rigid("end"), rf.NumericalDamping(0.05)]
rows = []
for element in ("enhanced", rf.AssumedStrains("outside")):
    scene = rf.Scene(domain, SOFT, effects, element=element)
    for r in rf.simulate(scene, 0.02, 0.1):
        rows.append([r.kinetic, r.strain, *r.linear_momentum, *r.angular_momentum])
if scene.comm.rank == 0:
    report(np.array(rows).tolist())

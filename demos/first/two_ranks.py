"""The same script on one rank or on several: a bar that is pulled at both ends and let go.

./fenicsx mpirun -n 2 python3 demos/first/two_ranks.py
"""

import numpy as np

import rigidfx as rf

bar = rf.box((0, 0, 0), (8, 1, 1), (16, 2, 2))  # its cells are divided among the ranks
rubber = rf.StVenantKirchhoff(E=1e6, nu=0.3, rho=1000.0)  # Pa, 1, kg/m³
pulls = [rf.Traction(face, (sign * 1e4, 0, 0), until=0.2) for face, sign in (("x0", -1), ("x1", 1))]
scene = rf.Scene(bar, rubber, pulls, probes={"end": (8, 0.5, 0.5)})
comm = scene.comm

# Reports are equal on all ranks; arrays over cells and nodes are those of a rank.
let_go = None
for report in rf.simulate(scene, dt=0.02, t_end=1.0):
    if report.t >= 0.2 and let_go is None:
        let_go = report.energy
owned = scene.mesh.topology.index_map(3).size_local
cells = comm.allgather(owned)
ends = comm.allgather(report.probes["end"][0])

if comm.rank == 0:  # one rank prints
    print(f"{comm.size} rank(s) with {cells} cells; the end moved by {1e3 * ends[0]:.3f} mm")
    print(f"energy {report.energy:.9f} J, as the loads ended {let_go:.9f} J")

assert sum(cells) == 64
assert ends == [ends[0]] * comm.size
assert abs(report.energy / let_go - 1) < 1e-10
assert np.abs(report.linear_momentum).max() < 1e-9 * report.momentum_scale

"""Histories of u, e and its reactions, on as many ranks.

Bodies freeze, wake and freeze anew; a support begins.
"""

from __future__ import annotations

import numpy as np
from parallel import report

import rigidfx as rf

DT = 0.02  # s


def shaken(t):
    return 0.0, 0.0, 0.02 * np.sin(2 * np.pi * t) * min(1.0, t / 2) ** 3


soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))
box = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))
box = box.with_cells("stalk", lambda x: x[0] <= 2 + 1e-9)
box = box.with_cells("block", lambda x: x[0] >= 2 - 1e-9)
late = rf.Fixed("x1", since=2.4)
effects = [rf.PrescribedMotion("x0", displacement=shaken), rf.MassDamping(1.0), late]
scene = rf.Scene(box, {"stalk": soft, "block": stiff}, effects, probes={"tip": (8, 0.5, 0.5)})


def histories():
    u, e, held, switches = [], [], [], []
    for r in rf.simulate(scene, DT, 2.8, rigidify=rf.StrainRate(2e-3, 20 * DT), progress=False):
        e.append(r.error_motion["tip"])
        u.append(r.probes["tip"] - e[-1])
        held.append(r.error_reactions.get("x0", np.zeros(3)))
        switches.append([event.kind for event in r.events])
    rows = {name: np.array(own).tolist() for name, own in (("u", u), ("e", e), ("held", held))}
    return rows | {"switches": switches}


if __name__ == "__main__":
    found = histories()
    if scene.comm.rank == 0:
        report(found)

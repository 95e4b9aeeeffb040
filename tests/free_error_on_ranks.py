"""e by modes of a part that nothing holds, at its probe."""

from __future__ import annotations

import numpy as np
from error_on_ranks import DT, box, soft, stiff
from parallel import report

import rigidfx as rf
from rigidfx.error import equations

effects = [
    rf.Traction("x1", (0, 0, 100.0), time=lambda t: np.sin(2 * np.pi * t / 3)),
    rf.KelvinVoigt(3e3),
    rf.MassDamping(0.5),
]
scene = rf.Scene(box, {"stalk": soft, "block": stiff}, effects, probes={"tip": (8, 0.5, 0.5)})
largest, equations.LARGEST = equations.LARGEST, 0
shown = strained = 0.0
for r in rf.simulate(scene, DT, 2.0, rigidify=rf.StrainRate(2e-4, 20 * DT), progress=False):
    shown = max(shown, float(np.abs(r.error_motion["tip"]).max()))
    strained = max(strained, r.ledger.withheld.spent)
equations.LARGEST = largest  # ranks run other scripts, too
if scene.comm.rank == 0:
    report({"shown": shown, "strained": strained})

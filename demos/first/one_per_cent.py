"""One per cent, please: a run that chooses Δt and rigid parts by itself, and how far off it is.

./fenicsx python3 demos/first/one_per_cent.py
"""

import numpy as np

import rigidfx as rf

bar = rf.box((0, 0, 0), (8, 1, 1), (16, 1, 1))  # m
bar = bar.with_cells("stalk", lambda x: x[0] <= 4 + 1e-9)
bar = bar.with_cells("block", lambda x: x[0] >= 4 - 1e-9)
soft, stiff = (rf.StVenantKirchhoff(E=E, nu=0.3, rho=1000.0) for E in (1e6, 1e8))  # Pa, 1, kg/m³
pull = rf.Traction("x1", (0, 0, 40.0), time=lambda t: np.sin(np.pi * t) ** 2, until=1.0)  # Pa
scene = rf.Scene(
    bar,
    {"stalk": soft, "block": stiff},
    [rf.Fixed("x0"), pull, rf.MassDamping(1.0)],
    element="enhanced",
    probes={"tip": (8, 0.5, 0.5)},
)

# The displacement of the tip may be off by one per cent of its largest value so far.
asked = rf.Accuracy(0.01, at="tip", min_cells=2)
chosen = list(rf.simulate(scene, dt=0.2, t_end=4.0, accuracy=asked))
ledger = chosen[-1].ledger
print(ledger)

# For comparison, the same with a given, short Δt.
exact = list(rf.simulate(scene, dt=0.01, t_end=4.0))
t, u = np.array([(r.t, r.probes["tip"][2]) for r in exact]).T
largest = np.abs(u).max()
off = max(abs(r.probes["tip"][2] - np.interp(r.t, t, u)) for r in chosen) / largest
print(f"{len(chosen) - 1} steps in place of {len(exact) - 1}; the tip is {100 * off:.2f} % off")

assert off < 0.01
assert len(chosen) < len(exact)
